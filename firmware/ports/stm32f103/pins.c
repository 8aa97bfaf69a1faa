/* Pin assignment of this board, in its pin sets (RM0008 9.1.11, 9.2, 9.3; table in docs/reference/pins.md).
 */
#include "pins.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "generated/used_parts.h"
#include "stm32f103.h"

#define ARM_SWITCH 14U /* PC14, to ground */

/* A pin's four mode bits, in CRL for pins 0 to 7 and in CRH for pins 8 to 15. */
void pins_set_mode(volatile uint32_t *control, uint32_t pin, uint32_t mode) {
    const uint32_t shift = 4U * (pin % 8U);
    *control = (*control & ~(0xfU << shift)) | (mode << shift);
}

void pins_clocks(void) {
    RCC_APB2ENR |= RCC_APB2ENR_AFIOEN | RCC_APB2ENR_IOPAEN | RCC_APB2ENR_IOPBEN | RCC_APB2ENR_IOPCEN;
}

/* Earlier firmware may have left the 32 kHz oscillator on. It keeps running over resets on a battery, and
 * keeps PC14 from being an input (RM0008 9.3.1). */
static void stop_low_speed_oscillator(void) {
    RCC_APB1ENR |= RCC_APB1ENR_PWREN;
    PWR_CR |= PWR_CR_DBP;
    RCC_BDCR &= ~RCC_BDCR_LSEON;
    PWR_CR &= ~PWR_CR_DBP;
    RCC_APB1ENR &= ~RCC_APB1ENR_PWREN;
}

/* Eight pins at a time, from pin 7 or 15 down. */
#define MODES(p7, p6, p5, p4, p3, p2, p1, p0)                                                                \
    ((p7) << 28 | (p6) << 24 | (p5) << 20 | (p4) << 16 | (p3) << 12 | (p2) << 8 | (p1) << 4 | (p0))
#define UP(pin)   (1U << (pin)) /* in BSRR: the pull, or the level, of a pin */
#define DOWN(pin) (1U << (16U + (pin)))

#define ANALOG PIN_ANALOG
#define FREE   PIN_FLOATING
#define INPUT  PIN_INPUT_PULLED
#define OUTPUT PIN_OUTPUT_10MHZ
#define SIGNAL PIN_ALTERNATE_10MHZ
#define PULSE  PIN_ALTERNATE_2MHZ
#define DRAIN  (USED_DIGITAL ? PIN_ALTERNATE_DRAIN : FREE)
#define SPI    (USED_DIGITAL ? SIGNAL : FREE)

void pins_init(uint32_t pins, bool actuators) {
    stop_low_speed_oscillator();
    const bool bridge = pins == BOARD_PINS_BRIDGE;
    const bool uart =
        pins != BOARD_PINS_UNKNOWN; /* else its pins may drive the gates of a bridge or a speed controller */
    const uint32_t tx = uart ? SIGNAL : FREE, rx = uart ? INPUT : FREE;
    const bool wheels = board_pins_wheels(pins);
    const uint32_t sticks = board_pins_receiver(pins) ? INPUT : FREE;
    const uint32_t gate = actuators && board_pins_bridge(pins) ? SIGNAL : FREE;
    const uint32_t pair = actuators && board_pins_pulses(pins) ? PULSE : FREE; /* two speed controllers */
    const bool rotors = board_pins_rotors(pins);
    const uint32_t inputs_or_rotors = !rotors ? ANALOG : actuators ? PULSE : FREE;
    /* MAPR is written as a whole, because SWJ_CFG reads back undefined. I2C1 is remapped away from PB6 and
     * PB7 even when unused: otherwise a remapped USART1 does not reach these pins. */
    AFIO_MAPR = AFIO_MAPR_SWJ_CFG_SWD | AFIO_MAPR_I2C1_REMAP |
                (bridge ? AFIO_MAPR_USART1_REMAP | AFIO_MAPR_TIM2_REMAP_FULL : 0U);
    /* Levels and pulls first. PA4: the SPI chip is deselected. PA10, PB7, PA11, PB11: an open line reads
     * idle. PB4, PB5: the strap. The Hall sensors have open collectors. The break input is pulled down: an
     * open wire trips it. */
    GPIOA_BSRR = UP(4) | UP(6) | UP(10) | UP(11) | UP(15);
    GPIOB_BSRR = UP(3) | UP(4) | UP(5) | UP(7) | UP(10) | DOWN(12) | (USED_RECEIVER ? UP(11) : 0U);
    GPIOC_BSRR = UP(ARM_SWITCH);
    /* SPI1 MOSI, MISO, SCK, select; ADC1 inputs 3 to 0, or TIM2 channels 4 to 1, the rotors. */
    GPIOA_CRL = MODES(SPI, INPUT, SPI, OUTPUT, inputs_or_rotors, inputs_or_rotors, inputs_or_rotors,
                      inputs_or_rotors);
    if (wheels) {
        /* Low; motors_arm() gives two of them to the timer. */
        const uint32_t motor = actuators ? OUTPUT : FREE;
        GPIOA_BSRR = UP(0) | UP(1) | UP(3) | DOWN(8);
        GPIOB_BSRR = UP(6) | DOWN(0) | DOWN(1) | DOWN(13) | DOWN(14) | DOWN(15);
        /* SPI1 as above; the rider's switch; the battery; TIM2, the left encoder. */
        GPIOA_CRL = MODES(SPI, INPUT, SPI, OUTPUT, INPUT, ANALOG, INPUT, INPUT);
        /* SWD; CAN TX, RX; USART1 RX, TX; the left motor forward. */
        GPIOA_CRH = MODES(FREE, FREE, FREE, SIGNAL, INPUT, rx, tx, motor);
        /* TIM4, the right encoder; strap; the right motor backward, forward. */
        GPIOB_CRL = MODES(INPUT, INPUT, INPUT, INPUT, FREE, FREE, motor, motor);
        /* TIM1 channels 3N and 2N, the motors; the left one backward; break; USART3 RX, the receiver; I2C1.
         */
        GPIOB_CRH = MODES(motor, motor, motor, INPUT, sticks, FREE, DRAIN, DRAIN);
    } else if (bridge) {
        /* Hall A; SWD; CAN TX, RX; TIM1 high sides C, B, A. */
        GPIOA_CRH = MODES(INPUT, FREE, FREE, SIGNAL, INPUT, gate, gate, gate);
        /* USART1 RX, TX; strap; Hall B; ADC1 inputs 9, 8. */
        GPIOB_CRL = MODES(rx, tx, INPUT, INPUT, INPUT, FREE, ANALOG, ANALOG);
        /* TIM1 low sides C, B, A, break; Hall C; I2C1 SDA, SCL. */
        GPIOB_CRH = MODES(gate, gate, gate, INPUT, FREE, INPUT, DRAIN, DRAIN);
    } else {
        /* SWD; CAN TX, RX; USART1 RX, TX; TIM1 channel 1, the receiver. */
        GPIOA_CRH = MODES(FREE, FREE, FREE, SIGNAL, INPUT, rx, tx, sticks);
        /* TIM4 channels 2 and 1, the speed controllers; strap; ADC inputs 9, 8: sensors, or the battery. */
        GPIOB_CRL = MODES(pair, pair, INPUT, INPUT, FREE, FREE, ANALOG, ANALOG);
        /* USART3 RX, the receiver; I2C1 SDA, SCL. */
        GPIOB_CRH = MODES(FREE, FREE, FREE, FREE, sticks, FREE, DRAIN, DRAIN);
    }
    GPIOC_CRH = MODES(FREE, INPUT, FREE, FREE, FREE, FREE, FREE, FREE); /* PC14: arm switch */
}

void pins_rotors_low(void) {
    GPIOA_BSRR = DOWN(0) | DOWN(1) | DOWN(2) | DOWN(3);
    GPIOA_CRL = (GPIOA_CRL & 0xffff0000U) | MODES(0U, 0U, 0U, 0U, OUTPUT, OUTPUT, OUTPUT, OUTPUT);
}

bool board_arm_switch(void) {
    return (GPIOC_IDR & 1U << ARM_SWITCH) == 0U;
}
