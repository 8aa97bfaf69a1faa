/* The flash that keeps saved parameters. */
#ifndef PLUMB_BOARD_STORE_H
#define PLUMB_BOARD_STORE_H

#include <stdbool.h>
#include <stdint.h>

/* Two slots of flash that keep what is saved, of BOARD_STORE_HALFWORDS each. Readable at any time, before
 * board_init() too. */
#define BOARD_STORE_SLOTS     2u
#define BOARD_STORE_HALFWORDS 1024u
const uint16_t *board_store_slot(uint32_t slot);

/* Erase a slot: all its bits become 1. The processor stands still for up to 80 ms and feeds the watchdog:
 * only while nothing moves. False: refused. A worn bit shows when it is programmed. */
bool board_store_erase(uint32_t slot);

/* Program one erased half-word; 0 may be programmed over anything. 70 us. False: refused. */
bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value);

#endif
