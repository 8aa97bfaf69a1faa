/* The flash memory of saved parameters. */
#ifndef PLUMB_BOARD_STORE_H
#define PLUMB_BOARD_STORE_H

#include <stdbool.h>
#include <stdint.h>

/* Two slots of BOARD_STORE_HALFWORDS half-words each. They can be read at any time, also before board_init().
 */
#define BOARD_STORE_SLOTS     2U
#define BOARD_STORE_HALFWORDS 1024U
const uint16_t *board_store_slot(uint32_t slot);

/* Erase a slot: all its bits become 1. The processor stalls for up to 80 ms (the watchdog is fed), so call it
 * only while the actuators are at neutral. False: refused. A worn bit shows when it is programmed. */
bool board_store_erase(uint32_t slot);

/* Program one erased half-word; 0 may be programmed over anything. 70 us. False: refused. */
bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value);

#endif
