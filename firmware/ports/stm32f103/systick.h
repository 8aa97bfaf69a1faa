/* Time of the board: milliseconds from SysTick. systick.c implements board_now_us(), too. */
#ifndef PLUMB_STM32F103_SYSTICK_H
#define PLUMB_STM32F103_SYSTICK_H

#include <stdint.h>

/* After clock_init(). */
void systick_init(void);

/* Call from the SysTick interrupt, every millisecond. */
void systick_count(void);

/* Milliseconds since the start, modulo 2^32. */
uint32_t systick_ms(void);

#endif
