/* Sleep of the main loop: idle.c implements board_idle(). */
#ifndef PLUMB_STM32F103_IDLE_H
#define PLUMB_STM32F103_IDLE_H

#include <stdbool.h>

extern volatile bool idle_over;

/* Wake the main loop, or keep it from sleeping before its next turn. Called by interrupts and by the loop. */
static inline void idle_end(void) {
    idle_over = true;
}

#endif
