/* Parameters that survive: two slots of flash, of which the newer whole one counts.
 *
 * A slot, in half-words, in the order in which they are programmed:
 *
 *     magic (2)  sequence (2)  count (1)  count times: id (1), value (2)  CRC-32 of all of it (2)  seal (1)
 *
 * A value is kept under the id of its row's name, so another version of the table finds what it still has.
 * The seal is 0x0000 and comes last, after everything was read back: without it a slot does not exist. Saving
 * writes the slot that is not in use; so whenever power fails, the old set is there or the new one is, and
 * nothing else. Before the other slot is erased, the seal of the one in use is programmed again, which flash
 * allows for zeros only: a half-word that power failed in may read either way until then. An interrupted
 * erase may look finished, so no slot is written without being erased first. Sequence numbers are compared
 * modulo 2^32.
 *
 * Only app/board_store.h is used: reading needs no board_init(). */
#ifndef PLUMB_LINK_STORE_H
#define PLUMB_LINK_STORE_H

#include "generated/params.h"

typedef enum {
    STORE_NOTHING = 0, /* no set is saved */
    STORE_LOADED = 1,  /* a saved set is in use */
    STORE_DAMAGED = 2, /* a set was saved, and can no longer be read */
    STORE_REFUSED = 3  /* the saved set contradicts itself or this version's limits */
} store_found_t;

typedef struct {
    store_found_t found;
    uint32_t sequence; /* of the slot that counts, 0 with none: how often was saved */
    uint16_t unknown;  /* saved values that this version has no row for: skipped */
    uint16_t missing;  /* rows that the saved set does not know: at their defaults */
} store_report_t;

/* What a set must keep beyond each row's range, to be used at all. */
bool store_accepts(const params_t *params);

/* *params becomes the saved set, missing rows at their defaults; all defaults where the report is not
 * STORE_LOADED. */
store_report_t store_load(params_t *params);

/* Save *params. Blocks: up to two page erases and 3 * PARAMS_COUNT half-words, 0.2 s in all. A set that is
 * saved already is not written again. *sequence: that of the slot that counts now. False: the flash did not
 * take it, and what was saved before is still there. */
bool store_save(const params_t *params, uint32_t *sequence);

#endif
