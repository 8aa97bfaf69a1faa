/* Pulses to speed controllers, on TIM4 or TIM2. pwm.c implements the board_..._actuator...() functions of
 * app/board_actuators.h, which also switch the bridge and the motors of two wheels. */
#ifndef PLUMB_STM32F103_PWM_H
#define PLUMB_STM32F103_PWM_H

#include <stdbool.h>
#include <stdint.h>

/* Start neutral pulses: of two controllers with BOARD_PINS_STANDARD, of four with BOARD_PINS_QUADROTOR. With
 * other pins the outputs stay disabled. */
void pwm_init(uint32_t pins);

/* True while an output drives although the outputs were told to be at neutral: a stray write reached a
 * register. */
bool pwm_astray(void);

/* Set every output to its safe state from constants: for the fault handler, which must not trust memory. */
void pwm_crash(void);

#endif
