/* Independent watchdog (RM0008 19): the main loop must come round, or the board resets.
 *
 * 625 counts of LSI / 16: 250 ms at its nominal 40 kHz, 167 to 333 ms over its range of 60 to 30 kHz. */
#include "port.h"

#define RELOAD       625u
#define UPDATE_POLLS 1000u /* five LSI cycles, 170 us, for each of the two registers */

static uint32_t fed_ms;

void watchdog_init(void) {
    IWDG_KR = IWDG_KR_KEY_START; /* starts LSI too, without which the registers do not update */
    IWDG_KR = IWDG_KR_KEY_UNLOCK;
    IWDG_PR = IWDG_PR_PR_DIV16;
    IWDG_RLR = RELOAD;
    (void)clock_wait(&IWDG_SR, IWDG_SR_PVU | IWDG_SR_RVU, 0u, UPDATE_POLLS);
    watchdog_feed();
}

void watchdog_feed(void) {
    IWDG_KR = IWDG_KR_KEY_FEED;
}

void board_feed_watchdog(void) {
    const uint32_t now_ms = time_ms();
    if (now_ms != fed_ms) { /* once a millisecond is plenty */
        fed_ms = now_ms;
        watchdog_feed();
    }
}
