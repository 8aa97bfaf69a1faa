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

/* idle_tell(): board_work_waits() is true until the next whole turn begins. An interrupt has found what that
 * turn fetches, or what board_sensor_health() tells and what may be over before.
 * idle_turns(): that turn begins. */
#if USED_ACTUATORS
extern volatile bool idle_news;
static inline void idle_tell(void) {
    idle_news = true;
}
static inline void idle_turns(void) {
    idle_news = false;
}
#else
static inline void idle_tell(void) {}
static inline void idle_turns(void) {}
#endif

#endif
