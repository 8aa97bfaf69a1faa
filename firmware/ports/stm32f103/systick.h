/* Time of the board: milliseconds from SysTick; microseconds by board_now_us(). */
#ifndef PLUMB_STM32F103_SYSTICK_H
#define PLUMB_STM32F103_SYSTICK_H

#include <stdint.h>

/* After clock_init(). */
void systick_init(void);

/* From the interrupt of the millisecond. */
void systick_count(void);

/* Since the start, modulo 2^32. */
uint32_t systick_ms(void);

#endif
