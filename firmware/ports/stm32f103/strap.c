/* The pin-set strap: PB4 and PB5, pulled up inside the chip, each left open or tied to ground by the wiring.
 * The strap alone chooses the pin set. It is read once, before any pin is an output.
 *
 * After reset PB4 is the debug port's NJTRST: SWJ_CFG frees it first (RM0008 9.3.5, table 38). */
#include "strap.h"
#include "app/board.h"
#include "clock.h"
#include "pins.h"
#include "stm32f103.h"

#define PULL_POLLS   (clock_mhz() * 500U / 64U) /* 0.5 ms: ten time constants of 50 kOhm and 1 nF */
#define READS        8U
#define READ_POLLS   (clock_mhz() * 20U / 64U) /* 20 us between two reads */
#define PB4_GROUNDED 1U
#define PB5_GROUNDED 2U

/* Waits at least polls * 64 cycles: the masked value is never 1. */
static void wait(uint32_t polls) {
    (void)clock_wait(&GPIOB_IDR, 0U, 1U, polls);
}

uint32_t strap_read(void) {
    static const uint8_t sets[] = BOARD_PINS_BY_STRAP;

    AFIO_MAPR = AFIO_MAPR_SWJ_CFG_SWD; /* pins_init() writes it whole */
    GPIOB_BSRR = 1U << 4 | 1U << 5;
    pins_set_mode(&GPIOB_CRL, 4U, PIN_INPUT_PULLED);
    pins_set_mode(&GPIOB_CRL, 5U, PIN_INPUT_PULLED);
    wait(PULL_POLLS);
    uint32_t always = PB4_GROUNDED | PB5_GROUNDED, ever = 0U;
    for (uint32_t i = 0U; i < READS; i++) {
        const uint32_t grounded = ~(GPIOB_IDR >> 4) & (PB4_GROUNDED | PB5_GROUNDED);
        always &= grounded;
        ever |= grounded;
        wait(READ_POLLS);
    }
    return always == ever ? sets[always] : BOARD_PINS_UNKNOWN;
}
