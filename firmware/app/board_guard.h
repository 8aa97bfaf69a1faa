/* Check words over the memory that decides a pulse: damage is found before it is used. */
#ifndef PLUMB_BOARD_GUARD_H
#define PLUMB_BOARD_GUARD_H

#include <stdbool.h>

/* Objects with one of these attributes decide whether and how something moves. A check word is kept over each
 * of the two areas, over every object that is placed there. Only the main loop may write them, and nothing
 * may while it is in board_idle(). Their first value is 0. */
#ifndef BOARD_GUARDED /* a port may choose other sections */
#define BOARD_GUARDED            __attribute__((section(".bss.guarded")))
#define BOARD_GUARDED_PARAMETERS __attribute__((section(".bss.guarded_parameters")))
#endif

/* To be called when the loop goes idle: what BOARD_GUARDED holds is right. */
void board_memory_seal(void);

/* Instead: it is not to be checked until the next seal. */
void board_memory_release(void);

/* To be called at once after a change: what BOARD_GUARDED_PARAMETERS holds is right. */
void board_parameters_seal(void);

/* Before guarded memory is used again: true when both areas are as they were sealed, or released. False
 * latches BOARD_FAULT_UPSET until the next start. */
bool board_memory_intact(void);

#endif
