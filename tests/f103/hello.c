/* A line of text on the UART, polled, then PC13 goes high. */
#include "part.h"
RESULTS;

int main(void) {
    results[0] = 0;
    clock_72mhz();
    RCC_APB2ENR = 1u << 14 | 1u << 4 | 1u << 2 | 1;
    GPIOA_CRH = 0x444444B4u;
    GPIOC_CRH = 0x44144444u;
    USART1_BRR = 78; /* 72 MHz: 923077 */
    USART1_CR1 = 1u << 13 | 8;
    const char text[] = "hello\n";
    for (uint32_t i = 0; text[i] != 0; i++) {
        while (!(USART1_SR & 1u << 7)) {
        }
        USART1_DR = (uint32_t)text[i];
    }
    GPIOC_BSRR = 1u << 13;
    for (;;) {
    }
}
