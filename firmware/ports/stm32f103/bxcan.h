/* CAN: board_can_...() of app/board_links.h. */
#ifndef PLUMB_STM32F103_BXCAN_H
#define PLUMB_STM32F103_BXCAN_H

#include <stdbool.h>

/* After clock_init(); stays off the bus when the clock is not the crystal's. */
void can_init(void);

/* True once received frames were lost. */
bool can_overrun(void);

void can_rx_handler(void);
void can_tx_handler(void);

#endif
