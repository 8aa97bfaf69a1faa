/* The two watchdogs; board_feed_watchdog() of app/board.h is the loop's. */
#ifndef PLUMB_STM32F103_WATCHDOG_H
#define PLUMB_STM32F103_WATCHDOG_H

/* After clock_init(). */
void watchdog_init(void);

void watchdog_feed(void);

/* Right before the processor stands still for up to 40 ms. */
void watchdog_feed_longest(void);

#endif
