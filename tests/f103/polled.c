/* The UART without DMA or interrupts; slow on purpose when told to, so that bytes overrun. */
#include "part.h"
RESULTS;

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    RCC_APB2ENR = 1U << 14 | 1U << 2 | 1;
    GPIOA_CRH = 0x444444B4U;
    USART1_BRR = 69; /* 8 MHz: 115942 */
    USART1_CR1 = 1U << 13 | 12;
    for (;;) {
        uint32_t status = USART1_SR;
        results[0] |= status;
        if (status & 1U << 5) {
            uint32_t byte = USART1_DR;
            if (byte == '!') {
                for (volatile uint32_t i = 0; i < 3000; i++) {
                }
            }
            while (!(USART1_SR & 1U << 7)) {
            }
            USART1_DR = byte;
        }
    }
}
