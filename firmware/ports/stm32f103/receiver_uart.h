/* USART3: the line of a radio receiver, in pin set `quadrotor`. */
#ifndef PLUMB_STM32F103_RECEIVER_UART_H
#define PLUMB_STM32F103_RECEIVER_UART_H

#include <stdint.h>

void receiver_uart_init(void);
void receiver_uart_handler(void);

/* Bytes that were lost or damaged; stops at 255. */
uint32_t receiver_uart_errors(void);

#endif
