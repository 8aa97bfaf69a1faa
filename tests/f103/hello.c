/* A line of text on the UART, polled, then PC13 goes high. */
#include "part.h"
RESULTS;

int main(void) {
    results[0] = 0;
    clock_72mhz();
    RCC_APB2ENR = 1U << 14 | 1U << 4 | 1U << 2 | 1;
    GPIOA_CRH = 0x444444B4U;
    GPIOC_CRH = 0x44144444U;
    USART1_BRR = 78; /* 72 MHz: 923077 */
    USART1_CR1 = 1U << 13 | 8;
    const char text[] = "hello\n";
    for (uint32_t i = 0; text[i] != 0; i++) {
        while (!(USART1_SR & 1U << 7)) {
        }
        USART1_DR = (uint32_t)text[i];
    }
    GPIOC_BSRR = 1U << 13;
    for (;;) {
    }
}
