/* Check words over the memory that decides the outputs, so that damage is found before that memory is used.
 */
#ifndef PLUMB_BOARD_GUARD_H
#define PLUMB_BOARD_GUARD_H

#include <stdbool.h>

/* Attributes of objects that decide whether and how an actuator moves. Each attribute places its objects in
 * an area of its own, and each area has one check word. Only the main loop may write such an object; nothing
 * may write it while the loop is in board_idle(). Its initial value is 0. */
#ifndef BOARD_GUARDED /* a port may choose other sections */
#define BOARD_GUARDED            __attribute__((section(".bss.guarded")))
#define BOARD_GUARDED_PARAMETERS __attribute__((section(".bss.guarded_parameters")))
#endif

/* Compute the check word over BOARD_GUARDED. Call when the loop goes idle. */
void board_memory_seal(void);

/* Call instead of board_memory_seal() to leave the area unchecked until the next seal. */
void board_memory_release(void);

/* Compute the check word over BOARD_GUARDED_PARAMETERS. Call at once after every change of them. */
void board_parameters_seal(void);

/* True when both areas match their check words, or are released. Call before guarded memory is used again.
 * False latches BOARD_FAULT_UPSET until the next start. */
bool board_memory_intact(void);

#endif
