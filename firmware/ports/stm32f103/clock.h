/* Clock tree: 72 MHz from a crystal, else 64 MHz, else 8 MHz, from the internal oscillator. Timers run at the
 * same rate (RM0008 figure 8: the doubler behind APB1 = HCLK / 2). */
#ifndef PLUMB_STM32F103_CLOCK_H
#define PLUMB_STM32F103_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* try_crystal: false when it failed in the run before. False: it is not the crystal's clock that runs. */
bool clock_init(bool try_crystal);

/* Of the processor and the timers, as it really runs. */
uint32_t clock_mhz(void);

/* Of the peripherals on APB1: half of that, at most 36. */
uint32_t clock_pclk1_mhz(void);

/* Polls until (*address & mask) == value, at most `polls` times, at least 64 cycles apart; false when it gave
 * up. */
bool clock_wait(volatile const uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls);

#endif
