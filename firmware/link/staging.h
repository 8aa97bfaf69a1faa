/* Parameter staging: the table that a commit makes the one in use, and where the one in use came from.
 *
 * A host stages words one by one and commits the whole table by its CRC-32; saved and factory tables are
 * staged whole. One link stages at a time. The table in use is the caller's; staging_apply() alone changes it
 * and seals it (board_parameters_seal()), which is for an idle board only. */
#ifndef PLUMB_LINK_STAGING_H
#define PLUMB_LINK_STAGING_H

#include "routing.h"
#include "store.h"

/* Where the parameters in use come from, as IDENTITY says it. */
#define STAGING_FROM_HOST 4U /* committed and not saved; below: store_found_t */

typedef struct {
    params_t *table;      /* decides no pulse: a commit compares its CRC */
    bool pending;         /* a host has staged words and not committed them */
    link_t by;            /* the link of that host */
    store_report_t saved; /* what flash holds */
    uint16_t source;      /* of those in use: store_found_t or STAGING_FROM_HOST */
} staging_t;

/* Nothing is staged; nothing is saved. table: kept by the caller; becomes a copy of those in use. */
void staging_init(staging_t *s, params_t *table, const params_t *in_use);

/* What the start found in flash. */
void staging_loaded(staging_t *s, const store_report_t *report);

/* Forget what a link has staged: HELLO. */
void staging_discard(staging_t *s, link_t link, const params_t *in_use);

/* PARAM_GET of one word, and PARAM_SET: answered by PARAM_VALUE, PARAM_STAGED or NACK. Words that another
 * link has staged are discarded first. */
void staging_on_get(routing_t *routing, const request_t *q, const params_t *in_use);
void staging_on_set(staging_t *s, routing_t *routing, const request_t *q, const params_t *in_use);

/* PARAM_COMMIT: 0 when the staged table may be applied, else the reason of the NACK and its detail. */
uint16_t staging_check_commit(const staging_t *s, const can_frame_t *frame, uint16_t *detail);

/* EXECUTE SAVE, LOAD and DEFAULTS: 0, or the reason of the NACK. After SAVE nothing is to be applied; LOAD
 * and DEFAULTS stage their table, and LOAD of what cannot be used the one in use. SAVE blocks for up to 0.2
 * s. */
uint16_t staging_save(staging_t *s, const params_t *in_use);
uint16_t staging_load(staging_t *s, const params_t *in_use);
void staging_defaults(staging_t *s);

/* The staged table becomes the one in use. No run is on. */
void staging_apply(staging_t *s, params_t *in_use);

/* The table in use was committed by a host. */
void staging_committed(staging_t *s);

/* BOARD_FAULT_PARAMETERS while what flash holds cannot be used, else 0. */
uint32_t staging_faults(const staging_t *s);

#endif
