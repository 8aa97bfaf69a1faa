/* Gives the window watchdog its clock; the test writes its registers. Counts boots, keeps the reset flags of
 * the last, and notes in SysTick counts when the early warning came. */
#include "part.h"
RESULTS;

void irq0_handler(void) {
    results[3]++;
    results[4] = WWDG_CR;
    WWDG_SR = 0;
    if (results[5]) {
        WWDG_CR = 0xFF;
    }
}

int main(void) {
    if (results[0] != 0xB007U) {
        results[0] = 0xB007U;
        results[1] = results[3] = 0;
    }
    results[1]++;
    results[2] = RCC_CSR;
    RCC_CSR = 1U << 24;
    if (results[6]) {
        clock_72mhz();
    }
    RCC_APB1ENR = 1U << 11;
    NVIC_ISER(0) = 1;
    for (;;) {
    }
}
