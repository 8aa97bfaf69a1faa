/* The lines of a radio receiver: USART3 (receiver_uart.c), and TIM1 channel 1 on PA8, which has its pulse
 * train in pin set `quadrotor` (ppm_capture.c). An image without a receiver has neither. */
#ifndef PLUMB_STM32F103_RECEIVER_LINES_H
#define PLUMB_STM32F103_RECEIVER_LINES_H

#include "generated/used_parts.h"
#include <stdint.h>

void receiver_uart_init(void);
void ppm_capture_init(void);

#if USED_RECEIVER
void receiver_uart_handler(void);
void ppm_capture_handler(void);

/* Bytes that were lost or damaged: `others`, of the links, and those of the receiver; stops at 255. */
uint32_t receiver_uart_errors(uint32_t others);
#else
static inline void receiver_uart_handler(void) {}
static inline void ppm_capture_handler(void) {}
static inline uint32_t receiver_uart_errors(uint32_t others) {
    return others;
}
#endif

#endif
