/* Receives by the RXNE interrupt of USART3 on PB11, at 8 MHz: what SR and DR were in each, from result 8 on.
 * While result 1 is 1, interrupts are masked. */
#include "part.h"
RESULTS;

void usart3_handler(void) {
    const uint32_t status = USART3_SR, data = USART3_DR;
    if (results[0] < 56) {
        results[8 + results[0]] = status << 8 | data;
    }
    results[0]++;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    RCC_APB2ENR = 1U << 3;
    RCC_APB1ENR = 1U << 18;
    USART3_BRR = 19;
    NVIC_ISER(1) = 1U << 7;
    USART3_CR1 = 1U << 13 | 1U << 5 | 4;
    results[2] = 1;
    for (;;) {
        if (results[1]) {
            irq_off();
        } else {
            irq_on();
        }
    }
}
