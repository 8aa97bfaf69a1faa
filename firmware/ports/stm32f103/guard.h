/* Check words over memory: guard.c implements app/board_guard.h. */
#ifndef PLUMB_STM32F103_GUARD_H
#define PLUMB_STM32F103_GUARD_H

#include <stdint.h>

/* BOARD_FAULT_UPSET, or 0. */
uint32_t guard_faults(void);

/* Report that an output drove although nothing was armed. */
void guard_outputs_upset(void);

/* Report that the clock has gone backwards: the next board_memory_intact() returns false. */
void guard_clock_upset(void);

#endif
