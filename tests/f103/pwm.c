/* Two outputs of TIM4 at 400 Hz with preload; results[0] asks for a pulse in half microseconds. */
#include "part.h"
RESULTS;

int main(void) {
    results[0] = 2000;
    clock_72mhz();
    RCC_APB2ENR = 1U << 3 | 1;
    RCC_APB1ENR = 1U << 2;
    TIM_PSC(TIM4) = 35;
    TIM_ARR(TIM4) = 4999;
    TIM_CCMR1(TIM4) = 0x6868;
    TIM_CCR1(TIM4) = results[0];
    TIM_CCR2(TIM4) = 3000;
    TIM_CR1(TIM4) = 1U << 7;
    TIM_EGR(TIM4) = 1;
    TIM_CCER(TIM4) = 0x11;
    TIM_CR1(TIM4) = 1U << 7 | 1;
    GPIOB_CRL = 0xBB444444U;
    for (;;) {
        TIM_CCR1(TIM4) = results[0];
        for (volatile uint32_t i = 0; i < 100; i++) {
        }
    }
}
