/* Sleep of the main loop: idle.c implements board_idle(). */
#ifndef PLUMB_STM32F103_IDLE_H
#define PLUMB_STM32F103_IDLE_H

#include "generated/used_parts.h"
#include <stdbool.h>

extern volatile bool idle_over;

/* Wake the main loop, or keep it from sleeping before its next turn. Called by interrupts and by the loop. */
static inline void idle_end(void) {
    idle_over = true;
}

/* board_work_waits() is true once more: an interrupt has found what board_sensor_health() tells, and what may
 * be over before the next whole turn. */
#if USED_ACTUATORS
extern volatile bool idle_news; /* of work.c */
static inline void idle_tell(void) {
    idle_news = true;
}
#else
static inline void idle_tell(void) {}
#endif

#endif
