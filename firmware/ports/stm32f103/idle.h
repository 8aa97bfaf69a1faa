/* Sleep of the main loop, and what ends it (board_idle()). */
#ifndef PLUMB_STM32F103_IDLE_H
#define PLUMB_STM32F103_IDLE_H

#include <stdbool.h>

extern volatile bool idle_over;

/* From an interrupt, or the loop itself: there is something to do, so do not sleep again before a turn. */
static inline void idle_end(void) {
    idle_over = true;
}

#endif
