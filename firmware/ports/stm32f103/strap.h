/* Pin-set strap at PB4 and PB5. */
#ifndef PLUMB_STM32F103_STRAP_H
#define PLUMB_STM32F103_STRAP_H

#include <stdint.h>

/* The pin set that the strap chooses, BOARD_PINS_*. Call after clock_init() and pins_clocks(), before
 * pins_init(). Takes 0.7 ms. */
uint32_t strap_read(void);

#endif
