/* Parameter staging: a second parameter table, which a commit puts into use; and the source of the one in
 * use.
 *
 * A host stages words one by one and commits the whole table by its CRC-32; saved parameters and defaults are
 * staged as a whole. One link stages at a time. The table in use belongs to the caller; only staging_apply()
 * and staging_learn() change and seal it (board_parameters_seal()), between two steps. */
#ifndef PLUMB_LINK_STAGING_H
#define PLUMB_LINK_STAGING_H

#include "routing.h"
#include "store.h"

/* Where the parameters in use come from, as IDENTITY says it. */
#define STAGING_FROM_HOST 4U /* committed and not saved; below: store_found_t */

typedef struct {
    params_t *table;      /* needs no check word: a commit compares its CRC */
    bool pending;         /* a host has staged words and not committed them */
    link_t by;            /* the link of that host */
    store_report_t saved; /* what flash holds */
    uint16_t source;      /* of the parameters in use: store_found_t or STAGING_FROM_HOST */
    uint16_t unsafe;      /* staging_unsafe() of the parameters in use */
    params_live_t
        gains; /* of the table that came into use last while disarmed: at arming, of an armed board */
} staging_t;

/* Index of the first parameter with which an armed board would break a promise, PARAMS_COUNT: none. An image
 * that drives nothing is never armed, and names none. */
uint16_t staging_unsafe(const params_t *p);

/* Nothing is staged, nothing is saved. table: in memory that the caller keeps; becomes a copy of *in_use. */
void staging_init(staging_t *s, params_t *table, const params_t *in_use);

/* Report what store_load() found in flash. */
void staging_loaded(staging_t *s, const store_report_t *report);

/* Discard what a link has staged; for HELLO. */
void staging_discard(staging_t *s, link_t link, const params_t *in_use);

/* PARAM_GET of one word, and PARAM_SET: answered by PARAM_VALUE, PARAM_STAGED or NACK. Words that another
 * link has staged are discarded first. */
void staging_on_get(routing_t *routing, const request_t *q, const params_t *in_use);
void staging_on_set(staging_t *s, routing_t *routing, const request_t *q, const params_t *in_use);

/* PARAM_COMMIT: 0 when the staged table may be applied, else the reason of the NACK and its detail. */
uint16_t staging_check_commit(const staging_t *s, const can_frame_t *frame, uint16_t *detail);

#if CONTROL_LEARNS
/* Put what a run has learned into a parameter in use, by its index. A value outside its range, or one that
 * the step does not accept, changes nothing. Call only while no run is on. */
void staging_learn(params_t *in_use, uint16_t index, uint32_t value);
#endif

/* EXECUTE SAVE, LOAD and DEFAULTS; return 0 or the reason of the NACK. LOAD and DEFAULTS stage a table that
 * the caller then applies; a LOAD that fails stages a copy of the table in use. SAVE stages nothing, and
 * blocks for up to 0.2 s. */
uint16_t staging_save(staging_t *s, const params_t *in_use);
uint16_t staging_load(staging_t *s, const params_t *in_use);
void staging_defaults(staging_t *s);

/* Put the staged table into use. Call only while no run is on, or when only live parameters change. armed:
 * the gains that later changes are compared with stay. */
void staging_apply(staging_t *s, params_t *in_use, bool armed);

/* Call after a host's commit: the source of the parameters becomes STAGING_FROM_HOST. */
void staging_committed(staging_t *s);

/* BOARD_FAULT_PARAMETERS while the saved parameters cannot be used, else 0. */
uint32_t staging_faults(const staging_t *s);

#endif
