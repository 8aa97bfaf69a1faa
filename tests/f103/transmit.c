/* Sends a text by the TXE interrupt, whose line stays high while there is room: the handler must run again by
 * itself. */
#include "part.h"
RESULTS;
static const char text[] = "one interrupt per byte";
static volatile uint32_t place;

void usart1_handler(void) {
    results[0]++;
    if (USART1_SR & 1U << 7) {
        if (text[place] != 0) {
            USART1_DR = (uint8_t)text[place++];
        } else {
            USART1_CR1 &= ~(1U << 7);
        }
    }
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    RCC_APB2ENR = 1U << 14 | 1U << 2 | 1;
    GPIOA_CRH = 0x444444B4U;
    USART1_BRR = 69;
    NVIC_ISER(1) = 1U << 5;
    USART1_CR1 = 1U << 13 | 1U << 7 | 8;
    for (;;) {
        wait_for_interrupt();
    }
}
