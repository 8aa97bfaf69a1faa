/* The two watchdogs, WWDG and IWDG. Only a turn of the main loop feeds them.
 *
 * WWDG (RM0008 20) counts down at PCLK1 / 4096 / 2^WDGTB and resets below 0x40; it is as exact as the
 * crystal. When the loop hangs, even with masked interrupts, the board resets after at most 40 ms, and its
 * pins float from then on; the limit for safe outputs is 50 ms. A page erase, during which the processor
 * stalls for up to 40 ms, gets the longest count, 58 ms at 36 MHz. The window stays open, because an early
 * turn is no fault.
 *
 * IWDG (RM0008 19) is the last resort and has its own oscillator: 625 counts of LSI / 16, which is 250 ms at
 * the nominal 40 kHz, 167 to 333 ms over the range of 60 to 30 kHz. */
#include "watchdog.h"
#include "app/board.h"
#include "app/board_guard.h"
#include "clock.h"
#include "stm32f103.h"
#include "systick.h"

#define IWDG_RELOAD  625U
#define UPDATE_POLLS 1000U /* five LSI cycles, 170 us, for each of the two registers */
#define WWDG_DIVIDER 4096U
#define WWDG_RESET   0x3fU /* the count at which it resets */
#define WWDG_STEPS   64U   /* from the highest count to WWDG_RESET; the first step may be short */
#define WDGTB_SHIFT  7U    /* in WWDG_CFR */
#define HANG_US      40000U
#define ERASE_US     50000U /* the longest count must last longer than this */

static uint32_t fed_ms;
BOARD_GUARDED static uint32_t loop_count;

void watchdog_init(void) {
    const uint32_t pclk1_mhz = clock_pclk1_mhz();
    uint32_t prescaler = 0U;
    while (((WWDG_STEPS - 1U) * WWDG_DIVIDER << prescaler) < ERASE_US * pclk1_mhz) {
        prescaler++;
    }
    loop_count = WWDG_RESET + HANG_US * pclk1_mhz / (WWDG_DIVIDER << prescaler);
    RCC_APB1ENR |= RCC_APB1ENR_WWDGEN;
    WWDG_CFR = prescaler << WDGTB_SHIFT | WWDG_CFR_W;

    IWDG_KR = IWDG_KR_KEY_START; /* starts LSI too, without which the registers do not update */
    IWDG_KR = IWDG_KR_KEY_UNLOCK;
    IWDG_PR = IWDG_PR_PR_DIV16;
    IWDG_RLR = IWDG_RELOAD;
    (void)clock_wait(&IWDG_SR, IWDG_SR_PVU | IWDG_SR_RVU, 0U, UPDATE_POLLS);
    watchdog_feed_longest();
}

void watchdog_feed(void) {
    IWDG_KR = IWDG_KR_KEY_FEED;
    WWDG_CR = WWDG_CR_WDGA | (loop_count & WWDG_CR_T);
}

void watchdog_feed_longest(void) {
    IWDG_KR = IWDG_KR_KEY_FEED;
    WWDG_CR = WWDG_CR_WDGA | WWDG_CR_T;
}

void board_feed_watchdog(void) {
    const uint32_t now_ms = systick_ms();
    if (now_ms != fed_ms) { /* at most once a millisecond; a stopped SysTick is not fed */
        fed_ms = now_ms;
        watchdog_feed();
    }
}
