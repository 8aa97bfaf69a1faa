/* CAN: bxcan.c implements the board_can_...() functions of app/board_links.h. */
#ifndef PLUMB_STM32F103_BXCAN_H
#define PLUMB_STM32F103_BXCAN_H

#include <stdbool.h>

/* Call after clock_init(). Without the crystal the board stays off the bus. */
void can_init(void);

/* True if received frames have been lost since the start. */
bool can_overrun(void);

/* True when a received frame waits. */
bool can_frame_waits(void);

void can_rx_handler(void);
void can_tx_handler(void);

#endif
