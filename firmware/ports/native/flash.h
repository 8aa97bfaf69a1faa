/* The two slots of board_store.h in an array, with injection of power failures and worn bits. */
#ifndef PLUMB_NATIVE_FLASH_H
#define PLUMB_NATIVE_FLASH_H

#include "app/board_store.h"
#include <stddef.h>

#define FLASH_CELLS (BOARD_STORE_SLOTS * BOARD_STORE_HALFWORDS)

typedef struct {
    uint16_t cell[FLASH_CELLS];
} flash_t;

extern flash_t flash;
extern uint32_t flash_page_bytes; /* 1024 or 2048 */

/* Worn bits: always 0, always 1. */
extern uint16_t flash_stuck_low[FLASH_CELLS], flash_stuck_high[FLASH_CELLS];

/* A cell that was being programmed when power failed: it may read either way until it is programmed again.
 * FLASH_CELLS: none. */
extern size_t flash_weak;

/* True: every operation is refused. */
extern bool flash_refuses;

/* Pages erased and half-words programmed. */
extern uint32_t flash_operations;

/* Number of ways in which an operation may be left half done. */
#define FLASH_WAYS 4U

/* Called inside every operation, once for each way of leaving it half done, while the flash has the contents
 * that a power failure would leave; NULL: not called. */
extern void (*flash_half_done)(void);

/* Seed of the bits that a half-done operation has changed: the same seed gives the same flash after the same
 * power failure. */
extern uint8_t flash_seed;

/* A fingerprint of the cells, and its value after the last operation. Code that changes cells directly must
 * update that value. */
uint64_t flash_mark(void);
extern uint64_t flash_marked;

void flash_blank(void); /* all ones, nothing worn, 1 KiB pages, no callback */

#endif
