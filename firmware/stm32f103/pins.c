/* Which pin does what on this board, in both pin sets (RM0008 9.1.11, 9.2, 9.3; table in DESIGN.md). */
#include "port.h"

#define ARM_SWITCH 14u /* PC14, to ground */

/* A pin's four mode bits, in CRL for pins 0 to 7 and in CRH for pins 8 to 15. */
void pins_set_mode(volatile uint32_t *control, uint32_t pin, uint32_t mode) {
    const uint32_t shift = 4u * (pin % 8u);
    *control = (*control & ~(0xfu << shift)) | (mode << shift);
}

static void standard_pins(void) {
    pins_set_mode(&GPIOA_CRH, 9u, PIN_ALTERNATE_10MHZ); /* USART1_TX */
    GPIOA_BSRR = 1u << 10;                              /* pulled up: an open line is idle, not a break */
    pins_set_mode(&GPIOA_CRH, 10u, PIN_INPUT_PULLED);   /* USART1_RX */
    pins_set_mode(&GPIOB_CRL, 6u, PIN_ALTERNATE_2MHZ);  /* TIM4_CH1, first speed controller */
    pins_set_mode(&GPIOB_CRL, 7u, PIN_ALTERNATE_2MHZ);  /* TIM4_CH2, second */
}

static void bridge_pins(void) {
    pins_set_mode(&GPIOB_CRL, 6u, PIN_ALTERNATE_10MHZ); /* USART1_TX */
    GPIOB_BSRR = 1u << 7 | 1u << 3 | 1u << 10;          /* pulled up, as is the line of RX */
    pins_set_mode(&GPIOB_CRL, 7u, PIN_INPUT_PULLED);    /* USART1_RX */
    GPIOA_BSRR = 1u << 15;
    pins_set_mode(&GPIOA_CRH, 15u, PIN_INPUT_PULLED); /* TIM2_CH1, Hall A: open collectors */
    pins_set_mode(&GPIOB_CRL, 3u, PIN_INPUT_PULLED);  /* TIM2_CH2, Hall B */
    pins_set_mode(&GPIOB_CRH, 10u, PIN_INPUT_PULLED); /* TIM2_CH3, Hall C */
    GPIOB_BSRR = 1u << (16u + 12u);                   /* pulled down: a wire that is off breaks */
    pins_set_mode(&GPIOB_CRH, 12u, PIN_INPUT_PULLED); /* TIM1_BKIN */
    for (uint32_t phase = 0u; phase < 3u; phase++) {
        pins_set_mode(&GPIOA_CRH, 8u + phase, PIN_ALTERNATE_10MHZ);  /* TIM1_CH1 to CH3, high sides */
        pins_set_mode(&GPIOB_CRH, 13u + phase, PIN_ALTERNATE_10MHZ); /* TIM1_CH1N to CH3N, low sides */
    }
}

void pins_clocks(void) {
    RCC_APB2ENR |= RCC_APB2ENR_AFIOEN | RCC_APB2ENR_IOPAEN | RCC_APB2ENR_IOPBEN | RCC_APB2ENR_IOPCEN;
}

void pins_init(uint32_t pins) {
    /* The one write of MAPR, whole. I2C1 stays away from PB6 and PB7 even while it is not used: a remapped
     * USART1 does not come out of them otherwise. */
    AFIO_MAPR = AFIO_MAPR_SWJ_CFG_SWD | AFIO_MAPR_I2C1_REMAP |
                (pins == BOARD_PINS_BRIDGE ? AFIO_MAPR_USART1_REMAP | AFIO_MAPR_TIM2_REMAP_FULL : 0u);
    for (uint32_t pin = 0u; pin < 4u; pin++) { /* ADC1_IN0 to IN3: gyro, accelerometer, second axis, spare */
        pins_set_mode(&GPIOA_CRL, pin, PIN_ANALOG);
    }
    pins_set_mode(&GPIOB_CRL, 0u, PIN_ANALOG);           /* ADC1_IN8 */
    pins_set_mode(&GPIOB_CRL, 1u, PIN_ANALOG);           /* ADC1_IN9 */
    GPIOA_BSRR = 1u << 4 | 1u << 6;                      /* chip not selected; MISO pulled up */
    pins_set_mode(&GPIOA_CRL, 4u, PIN_OUTPUT_10MHZ);     /* select of the accelerometer */
    pins_set_mode(&GPIOA_CRL, 5u, PIN_ALTERNATE_10MHZ);  /* SPI1_SCK */
    pins_set_mode(&GPIOA_CRL, 6u, PIN_INPUT_PULLED);     /* SPI1_MISO */
    pins_set_mode(&GPIOA_CRL, 7u, PIN_ALTERNATE_10MHZ);  /* SPI1_MOSI */
    pins_set_mode(&GPIOB_CRH, 8u, PIN_ALTERNATE_DRAIN);  /* I2C1_SCL */
    pins_set_mode(&GPIOB_CRH, 9u, PIN_ALTERNATE_DRAIN);  /* I2C1_SDA */
    GPIOA_BSRR = 1u << 11;                               /* pulled up: without a transceiver nobody speaks */
    pins_set_mode(&GPIOA_CRH, 11u, PIN_INPUT_PULLED);    /* CAN_RX */
    pins_set_mode(&GPIOA_CRH, 12u, PIN_ALTERNATE_10MHZ); /* CAN_TX: recessive while the controller rests */
    GPIOC_BSRR = 1u << ARM_SWITCH;                       /* pulled up: no switch is an open switch */
    pins_set_mode(&GPIOC_CRH, ARM_SWITCH, PIN_INPUT_PULLED);
    if (pins == BOARD_PINS_BRIDGE) {
        bridge_pins();
    } else {
        standard_pins();
    }
}

bool board_arm_switch(void) {
    return (GPIOC_IDR & 1u << ARM_SWITCH) == 0u;
}
