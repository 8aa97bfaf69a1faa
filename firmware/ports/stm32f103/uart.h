/* USART1: uart.c implements the board_uart_...() functions of app/board_links.h. */
#ifndef PLUMB_STM32F103_UART_H
#define PLUMB_STM32F103_UART_H

#include <stdbool.h>
#include <stdint.h>

/* After clock_init(). */
void uart_init(void);

/* Received characters that were lost or damaged; stops at 255. */
uint32_t uart_errors(void);

/* True when as many received bytes wait as a frame has. Fewer are told (idle.h) when the line pauses. */
bool uart_line_waits(void);

void uart_handler(void);
void uart_rx_dma_handler(void);
void uart_tx_dma_handler(void);

#endif
