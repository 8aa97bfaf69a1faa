/* Three-phase bridge on TIM1, Hall sensors on TIM2. With another pin set than BOARD_PINS_BRIDGE,
 * bridge_init() is not called and the other functions do nothing; an image without a bridge has no bridge.c.
 */
#ifndef PLUMB_STM32F103_BRIDGE_H
#define PLUMB_STM32F103_BRIDGE_H

#include "generated/used_parts.h"
#include <stdbool.h>
#include <stdint.h>

/* Set up the timer with the bridge off and all gates driven low. Call after systick_init(), before the pins
 * become outputs. dead_time_ns: 200 to 3500, rounded up to timer counts. */
void bridge_init(uint32_t dead_time_ns);

/* Start the Hall sensors. Call after the pins are set up and have settled. */
void bridge_start(void);

#if USED_BRIDGE
/* Switch the bridge on, at duty 0. */
void bridge_arm(void);

/* Switch the bridge off, at any time. Reads no memory, so the fault handler may call it. */
void bridge_off(void);

/* BOARD_FAULT_BRIDGE and BOARD_FAULT_HALL. */
uint32_t bridge_faults(void);

/* Clear those faults whose cause is gone. */
void bridge_clear_faults(void);

/* True while the timer may drive the gates. Reads no memory. */
bool bridge_on(void);

/* Edges of the Hall sensors, forward minus backward, modulo 2^16. */
int16_t bridge_hall_count(void);

void bridge_handler(void);
#else
static inline void bridge_arm(void) {}
static inline void bridge_off(void) {}
static inline uint32_t bridge_faults(void) {
    return 0U;
}
static inline void bridge_clear_faults(void) {}
static inline bool bridge_on(void) {
    return false;
}
static inline int16_t bridge_hall_count(void) {
    return 0;
}
static inline void bridge_handler(void) {}
#endif

#endif
