/* The motors of two wheels: TIM1's outputs CH2N (PB14, left) and CH3N (PB15, right) as PWM, two direction
 * inputs of a driver each (PA8, PB13 and PB0, PB1). With another pin set than BOARD_PINS_WHEELS,
 * motors_init() is not called and the other functions do nothing; an image without wheels has no motors.c. */
#ifndef PLUMB_STM32F103_MOTORS_H
#define PLUMB_STM32F103_MOTORS_H

#include "generated/used_parts.h"
#include <stdbool.h>
#include <stdint.h>

/* Set up the timer with both motors off. Call before the pins become outputs. */
void motors_init(void);

#if USED_WHEELS
/* Switch the motors on, at duty 0. */
void motors_arm(void);

/* True while the timer may drive the motors. Reads no memory. */
bool motors_on(void);

/* PWM and directions low. Reads no memory, so the fault handler may call it; else call it with interrupts
 * masked: it changes pin modes that the recovery of I2C shares a register with. */
void motors_off(void);

/* BOARD_FAULT_BRIDGE: the break input has switched them off. */
uint32_t motors_faults(void);

/* Clear that fault when its cause is gone. */
void motors_clear_faults(void);
#else
static inline void motors_arm(void) {}
static inline bool motors_on(void) {
    return false;
}
static inline void motors_off(void) {}
static inline uint32_t motors_faults(void) {
    return 0U;
}
static inline void motors_clear_faults(void) {}
#endif

#endif
