/* Store: parameters saved in two slots of flash. The newer complete slot counts.
 *
 * A slot, in half-words, in the order in which they are programmed:
 *
 *     magic (2)  sequence (2)  count (1)  count times: id (1), value (2)  CRC-32 of all of it (2)  seal (1)
 *
 * A value is saved with the id of its parameter, so that another version of the table finds the parameters
 * that it still has, and an image with other systems those that both images hold. Parameters that this image
 * does not hold are not saved: another image then reports them as missing, and does not mistake a constant
 * for a value that was set.
 *
 * The seal is 0x0000 and is programmed last, after everything was read back: a slot without it counts as
 * empty. Saving writes the slot that is not in use; so whenever power fails, either the old set or the new
 * one is there. Before that slot is erased, the seal of the slot in use is programmed again, which flash
 * allows for zeros: a half-word that was being programmed when power failed may read either way until then.
 * An interrupted erase may look complete, so a slot is always erased before it is written. Sequence numbers
 * are compared modulo 2^32.
 *
 * Uses nothing but app/board_store.h: reading needs no board_init(). */
#ifndef PLUMB_LINK_STORE_H
#define PLUMB_LINK_STORE_H

#include "generated/params.h"

typedef enum {
    STORE_NOTHING = 0, /* no set is saved */
    STORE_LOADED = 1,  /* a saved set is in use */
    STORE_DAMAGED = 2, /* a set was saved, and can no longer be read */
    STORE_REFUSED = 3  /* the saved set is inconsistent or outside this version's limits */
} store_found_t;

typedef struct {
    store_found_t found;
    uint32_t sequence; /* number of the save in the slot that counts; 0: none */
    uint16_t unknown;  /* saved values without a parameter in this image: skipped */
    uint16_t missing;  /* held parameters that the saved set does not have: at their defaults */
} store_report_t;

/* True when a set keeps the conditions between parameters, which their single ranges do not cover. */
bool store_accepts(const params_t *params);

/* Load the saved set into *params, missing parameters at their defaults. Unless the report is STORE_LOADED,
 * all are at their defaults. */
store_report_t store_load(params_t *params);

/* Save *params. Blocks for up to two page erases and 3 * PARAMS_HELD half-words, 0.2 s in all. A set that is
 * saved already is not written again. *sequence: of the slot that counts now. False: the flash refused, and
 * the set saved before is still there. */
bool store_save(const params_t *params, uint32_t *sequence);

#endif
