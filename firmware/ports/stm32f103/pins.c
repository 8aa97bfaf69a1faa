/* Pin assignment of this board, in its pin sets (RM0008 9.1.11, 9.2, 9.3; host/plumb/spec/pin_sets.toml,
 * which docs/reference/pins.md shows). */
#include "pins.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "generated/pin_modes.h"
#include "stm32f103.h"

#define ARM_SWITCH 14U           /* PC14, to ground */
#define UP(pin)    (1U << (pin)) /* in BSRR: the pull, or the level, of a pin */
#define DOWN(pin)  (1U << (16U + (pin)))

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

/* What the registers of a port get: BSRR, the pulls and levels; CRL, the modes of pins 0 to 7; CRH, of 8
 * to 15. */
typedef struct {
    uint32_t levels, low, high;
} port_words_t;

typedef struct {
    port_words_t a, b;
} pin_modes_t;

void pins_init(uint32_t pins, bool actuators) {
    static const pin_modes_t modes[] = BOARD_PIN_MODES;
    static const uint8_t of[][2] = BOARD_PIN_MODES_OF;
    const pin_modes_t *const set = &modes[of[pins][actuators ? 1 : 0]];
    stop_low_speed_oscillator();
    /* MAPR is written as a whole, because SWJ_CFG reads back undefined. I2C1 is remapped away from PB6 and
     * PB7 even when unused: otherwise a remapped USART1 does not reach these pins. */
    AFIO_MAPR = AFIO_MAPR_SWJ_CFG_SWD | AFIO_MAPR_I2C1_REMAP | board_pins_remap(pins);
    /* Levels and pulls first. */
    GPIOA_BSRR = set->a.levels;
    GPIOB_BSRR = set->b.levels;
    GPIOC_BSRR = UP(ARM_SWITCH);
    GPIOA_CRL = set->a.low;
    GPIOA_CRH = set->a.high;
    GPIOB_CRL = set->b.low;
    GPIOB_CRH = set->b.high;
    GPIOC_CRH = 0x48444444U; /* pin 14 is a pulled input; the others are open */
}

void pins_rotors_low(void) {
    GPIOA_BSRR = DOWN(0) | DOWN(1) | DOWN(2) | DOWN(3);
    GPIOA_CRL = (GPIOA_CRL & 0xffff0000U) | PIN_OUTPUT_10MHZ * 0x1111U;
}

bool board_arm_switch(void) {
    return (GPIOC_IDR & 1U << ARM_SWITCH) == 0U;
}
