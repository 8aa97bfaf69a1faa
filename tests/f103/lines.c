/* USART2 on its pins, or remapped, answers every byte with the next one; results[0] chooses, before the
 * power-on. */
#include "part.h"
RESULTS;

#define USART2_SR  REG(0x40004400)
#define USART2_DR  REG(0x40004404)
#define USART2_BRR REG(0x40004408)
#define USART2_CR1 REG(0x4000440C)

void usart2_handler(void) {
    if (USART2_SR & 1U << 5) {
        USART2_DR = USART2_DR + 1U;
    }
}

int main(void) {
    RCC_APB2ENR = 1U | 1U << 2 | 1U << 5;
    RCC_APB1ENR = 1U << 17;
    if (results[0] == 1) {
        AFIO_MAPR = 1U << 3;
        REG(0x40011400) = 0x44B44444U; /* PD5: alternate function, push-pull */
    } else {
        GPIOA_CRL = 0x44444B44U; /* PA2 */
    }
    USART2_BRR = 8000000U / 115200U;
    USART2_CR1 = 1U << 13 | 1U << 5 | 1U << 3 | 1U << 2;
    NVIC_ISER(1) = 1U << (38 - 32);
    for (;;) {
        wait_for_interrupt();
    }
}
