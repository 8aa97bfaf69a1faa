/* Check words over memory: board_memory_...() of app/board_guard.h. */
#ifndef PLUMB_STM32F103_GUARD_H
#define PLUMB_STM32F103_GUARD_H

#include <stdint.h>

/* BOARD_FAULT_UPSET, or 0. */
uint32_t guard_faults(void);

/* Time went backwards: the next turn finds memory damaged. */
void guard_clock_upset(void);

#endif
