/* Which pin does what on this board: the `standard` pin set (RM0008 9.1.11 and 9.2; table in DESIGN.md). */
#include "port.h"

/* A pin's four mode bits, in CRL for pins 0 to 7 and in CRH for pins 8 to 15. */
#define PIN(number, mode) ((uint32_t)(mode) << (4u * ((number) % 8u)))
#define PIN_MASK(number)  PIN(number, 0xfu)

void pins_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_IOPAEN | RCC_APB2ENR_IOPBEN;
    /* PA0 gyro, PA1 and PA2 accelerometer: analog. */
    GPIOA_CRL = (GPIOA_CRL & ~(PIN_MASK(0u) | PIN_MASK(1u) | PIN_MASK(2u))) | PIN(0u, PIN_ANALOG) |
                PIN(1u, PIN_ANALOG) | PIN(2u, PIN_ANALOG);
    /* PA9 USART1_TX; PA10 USART1_RX, pulled up so that an open line is idle and not a break. */
    GPIOA_BSRR = 1u << 10;
    GPIOA_CRH = (GPIOA_CRH & ~(PIN_MASK(9u) | PIN_MASK(10u))) | PIN(9u, PIN_ALTERNATE_10MHZ) |
                PIN(10u, PIN_INPUT_PULLED);
    /* PB6 and PB7: TIM4_CH1 and CH2, pulses to the speed controllers. */
    GPIOB_CRL = (GPIOB_CRL & ~(PIN_MASK(6u) | PIN_MASK(7u))) | PIN(6u, PIN_ALTERNATE_2MHZ) |
                PIN(7u, PIN_ALTERNATE_2MHZ);
}
