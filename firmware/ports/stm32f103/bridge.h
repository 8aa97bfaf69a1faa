/* Three-phase bridge on TIM1, Hall sensors on TIM2. Without pin set `bridge`, bridge_init() is not called and
 * the others do nothing. */
#ifndef PLUMB_STM32F103_BRIDGE_H
#define PLUMB_STM32F103_BRIDGE_H

#include <stdint.h>

/* Off, all gates driven low; after systick_init(), before its pins are outputs. dead_time_ns: 200 to 3500,
 * rounded up. */
void bridge_init(uint32_t dead_time_ns);

/* Once its pins are set up, and had time to settle. */
void bridge_start(void);

/* Switch the bridge on, at duty 0. */
void bridge_arm(void);

/* At any time; reads no memory. */
void bridge_off(void);

/* BOARD_FAULT_BRIDGE, BOARD_FAULT_HALL. */
uint32_t bridge_faults(void);

/* Forget those that are over. */
void bridge_clear_faults(void);

/* Edges of the Hall sensors, forward less backward, modulo 2^16. */
int16_t bridge_hall_count(void);

void bridge_handler(void);

#endif
