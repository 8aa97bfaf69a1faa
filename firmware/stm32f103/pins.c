/* Which pin does what on this board: the `standard` pin set (RM0008 9.1.11 and 9.2; table in DESIGN.md). */
#include "port.h"

#define ARM_SWITCH 14u /* PC14, to ground */

/* A pin's four mode bits, in CRL for pins 0 to 7 and in CRH for pins 8 to 15. */
static void set_mode(volatile uint32_t *control, uint32_t pin, uint32_t mode) {
    const uint32_t shift = 4u * (pin % 8u);
    *control = (*control & ~(0xfu << shift)) | (mode << shift);
}

void pins_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_IOPAEN | RCC_APB2ENR_IOPBEN | RCC_APB2ENR_IOPCEN;
    set_mode(&GPIOA_CRL, 0u, PIN_ANALOG);          /* gyro */
    set_mode(&GPIOA_CRL, 1u, PIN_ANALOG);          /* accelerometer, tilt axis */
    set_mode(&GPIOA_CRL, 2u, PIN_ANALOG);          /* accelerometer, second axis */
    set_mode(&GPIOA_CRH, 9u, PIN_ALTERNATE_10MHZ); /* USART1_TX */
    GPIOA_BSRR = 1u << 10;                         /* pulled up: an open line is idle, not a break */
    set_mode(&GPIOA_CRH, 10u, PIN_INPUT_PULLED);   /* USART1_RX */
    set_mode(&GPIOB_CRL, 6u, PIN_ALTERNATE_2MHZ);  /* TIM4_CH1, first speed controller */
    set_mode(&GPIOB_CRL, 7u, PIN_ALTERNATE_2MHZ);  /* TIM4_CH2, second */
    GPIOC_BSRR = 1u << ARM_SWITCH;                 /* pulled up: no switch is an open switch */
    set_mode(&GPIOC_CRH, ARM_SWITCH, PIN_INPUT_PULLED);
}

bool board_arm_switch(void) {
    return (GPIOC_IDR & 1u << ARM_SWITCH) == 0u;
}
