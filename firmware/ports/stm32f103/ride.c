/* Quadrature encoders on TIM2 (PA0, PA1: left) and TIM4 (PB6, PB7: right), which count every edge of both
 * inputs in hardware (RM0008 15.3.12), and the rider's switch on PA3, to ground. A level counts when it lasts
 * for 3.6 us at 72 MHz, longer than a motor's brushes spark. */
#include "ride.h"
#include "stm32f103.h"
#include <stdbool.h>

#define RIDER 3U /* PA3 */

static bool counts(uint32_t timer) {
    return ENCODER_SMCR(timer) == ENCODER_SMCR_SMS_BOTH;
}

static void start(uint32_t timer) {
    PULSE_ARR(timer) = 0xffffU;
    PULSE_CCMR1(timer) = ENCODER_CCMR1_INPUTS | ENCODER_CCMR1_FILTERS_SLOWEST;
    ENCODER_SMCR(timer) = ENCODER_SMCR_SMS_BOTH;
    PULSE_CR1(timer) = PULSE_CR1_CEN;
}

void ride_init(void) {
    RCC_APB1ENR |= RCC_APB1ENR_TIM2EN | RCC_APB1ENR_TIM4EN;
    start(TIM2_BASE);
    start(TIM4_BASE);
}

void ride_read(int16_t found[RIDE_COUNTS]) {
    const bool there = counts(TIM2_BASE);
    found[0] = there ? (int16_t)PULSE_CNT(TIM2_BASE) : 0;
    found[1] = there ? (int16_t)PULSE_CNT(TIM4_BASE) : 0;
    found[2] = there && (GPIOA_IDR & 1U << RIDER) == 0U ? 1 : 0;
}
