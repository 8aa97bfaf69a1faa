/* The two watchdogs. The main loop calls board_feed_watchdog() of app/board.h instead of these. */
#ifndef PLUMB_STM32F103_WATCHDOG_H
#define PLUMB_STM32F103_WATCHDOG_H

/* After clock_init(). */
void watchdog_init(void);

void watchdog_feed(void);

/* Feed for a stall of the processor of up to 40 ms; call right before it. */
void watchdog_feed_longest(void);

#endif
