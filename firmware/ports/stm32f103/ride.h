/* What a vehicle on two wheels reads besides its inertial sensors: the encoders of its wheels and the rider's
 * switch. With another pin set than BOARD_PINS_WHEELS, ride_init() is not called and all reads 0. */
#ifndef PLUMB_STM32F103_RIDE_H
#define PLUMB_STM32F103_RIDE_H

#include <stdint.h>

#define RIDE_COUNTS 3U

/* Start both encoders. */
void ride_init(void);

/* Counts of the left and the right encoder, modulo 2^16, then 1 while the rider's switch is closed, else 0.
 */
void ride_read(int16_t counts[RIDE_COUNTS]);

#endif
