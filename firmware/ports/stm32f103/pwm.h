/* Speed controllers on TIM4: board_..._actuator...() of app/board_actuators.h, for both kinds of actuator. */
#ifndef PLUMB_STM32F103_PWM_H
#define PLUMB_STM32F103_PWM_H

#include <stdint.h>

/* Neutral pulses from here on; with pins other than BOARD_PINS_STANDARD none leave the chip. */
void pwm_init(uint32_t pins);

/* Every output safe, by constants: for code that may not trust memory. */
void pwm_crash(void);

#endif
