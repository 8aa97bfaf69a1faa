/* Clock tree: 72 MHz from a crystal; without one 64 MHz, or 8 MHz when the PLL does not lock, from the
 * internal oscillator. Timers run at the same rate (RM0008 figure 8: doubled when APB1 is HCLK / 2). */
#ifndef PLUMB_STM32F103_CLOCK_H
#define PLUMB_STM32F103_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* Start the clock. try_crystal: false when the crystal failed in the run before. Returns false when the
 * internal oscillator is in use. */
bool clock_init(bool try_crystal);

/* Clock of the processor and the timers: 72, 64 or 8. */
uint32_t clock_mhz(void);

/* Clock of the peripherals on APB1, at most 36. */
uint32_t clock_pclk1_mhz(void);

/* Polls until (*address & mask) == value, at most `polls` times, at least 64 cycles apart; false when the
 * value did not come. */
bool clock_wait(volatile const uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls);

#endif
