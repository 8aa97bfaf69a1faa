/* Seed for random numbers. */
#ifndef PLUMB_STM32F103_ENTROPY_H
#define PLUMB_STM32F103_ENTROPY_H

#include <stdint.h>

/* Seed that differs at every start; read once, by board_init(). */
uint32_t entropy_at_start(void);

#endif
