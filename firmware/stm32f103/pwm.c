/* Pulses to two speed controllers: TIM4 channels 1 and 2 count half-microseconds (RM0008 15.3.9, 15.4).
 *
 * Every compare register and the frame length are preloaded, so that a change takes effect between two pulses
 * and both outputs change together. Channel 3 has no pin: its compare register holds the neutral pulse, where
 * the fault handler finds it when no memory can be trusted. */
#include "port.h"

#define START_FRAME_HALFUS   5000u /* 400 Hz */
#define START_NEUTRAL_HALFUS 2000u /* 1 ms: motor off */

void pwm_init(uint32_t pins) {
    RCC_APB1ENR |= RCC_APB1ENR_TIM4EN;
    TIM4_PSC = clock_mhz() / 2u - 1u;
    TIM4_CCMR1 = TIM4_CCMR1_OC1M_PWM1 | TIM4_CCMR1_OC1PE | TIM4_CCMR1_OC2M_PWM1 | TIM4_CCMR1_OC2PE;
    board_configure_actuator(START_FRAME_HALFUS, START_NEUTRAL_HALFUS);
    board_actuator_neutral();
    TIM4_EGR = TIM4_EGR_UG;
    if (pins == BOARD_PINS_STANDARD) { /* else channel 1's pin is the UART's */
        TIM4_CCER = TIM4_CCER_CC1E | TIM4_CCER_CC2E;
    }
    TIM4_CR1 = TIM4_CR1_ARPE | TIM4_CR1_CEN;
}

void board_configure_actuator(uint32_t frame_halfus, uint32_t neutral_halfus) {
    TIM4_ARR = frame_halfus - 1u;
    TIM4_CCR3 = neutral_halfus;
}

void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]) {
    TIM4_CCR1 = pulse_halfus[0];
    TIM4_CCR2 = pulse_halfus[1];
}

void board_actuator_neutral(void) {
    const uint32_t neutral_halfus = TIM4_CCR3;
    TIM4_CCR1 = neutral_halfus;
    TIM4_CCR2 = neutral_halfus;
    bridge_off();
}
