/* Edges of pins by interrupt: a button on PA0 (falling), an encoder on PB5 and PB6 (both), a line by
 * software. */
#include "part.h"
RESULTS;

#define EXTI_IMR     REG(0x40010400)
#define EXTI_RTSR    REG(0x40010408)
#define EXTI_FTSR    REG(0x4001040C)
#define EXTI_SWIER   REG(0x40010410)
#define EXTI_PR      REG(0x40010414)
#define AFIO_EXTICR2 REG(0x4001000C)

void irq6_handler(void) {
    results[1] = results[1] + 1;
    EXTI_PR = 1;
}

void irq23_handler(void) {
    uint32_t pending = EXTI_PR & 0x60U;
    results[2] = results[2] + (pending & 0x20U ? 1U : 0U) + (pending & 0x40U ? 0x100U : 0U);
    EXTI_PR = pending;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    RCC_APB2ENR |= 1U | 4U | 8U;
    GPIOA_CRL = 0x44444448U; /* PA0: pulled */
    REG(0x4001080C) = 1;     /* up */
    GPIOB_CRL = 0x44444444U;
    AFIO_EXTICR2 = 0x0110U; /* lines 5 and 6: port B */
    EXTI_FTSR = 1U | 0x60U;
    EXTI_RTSR = 0x60U;
    EXTI_IMR = 1U | 0x60U;
    NVIC_ISER(0) = 1U << 6 | 1U << 23;
    results[0] = 1;
    for (;;) {
        if (results[8] == 1) {
            results[8] = 0;
            EXTI_SWIER = 1;
            results[3] = EXTI_SWIER; /* the handler has cleared it */
        }
        if (results[8] == 2) {
            results[8] = 0;
            EXTI_IMR = 0;
        }
        results[4] = EXTI_PR;
    }
}
