/* GPIO: which pin does what (table in docs/reference/pins.md). */
#ifndef PLUMB_STM32F103_PINS_H
#define PLUMB_STM32F103_PINS_H

#include <stdbool.h>
#include <stdint.h>

/* Switch on the clocks of the GPIO ports. */
void pins_clocks(void);

/* Set up all pins. pins: the pin set, BOARD_PINS_*. actuators: drive the pins of the speed controllers or of
 * the bridge; false: they float. */
void pins_init(uint32_t pins, bool actuators);

/* PA0 to PA3, the speed controllers of BOARD_PINS_QUADROTOR, become outputs that are low. Reads no memory. */
void pins_rotors_low(void);

/* control: the CRL or CRH that holds the pin's four mode bits; mode: PIN_*. */
void pins_set_mode(volatile uint32_t *control, uint32_t pin, uint32_t mode);

#endif
