/* Who may move the actuator: keep-alives and the hold, with the clock about to wrap. */
#include "arming.h"
#include "check.h"

#define NOW  0xFFFFF000U /* 4 ms before the clock wraps */
#define GONE 0x0008U     /* something that blocks */

static const arming_actuator_t actuator = {.frame_us = 2500U, .hold_us = 40000U};

static void keep_alives(void) {
    arming_t a;
    arming_init(&a);
    CHECK(!arming_arm(&a, GONE, 7U, actuator, NOW));
    CHECK(!arming_keepalive(&a, 7U, NOW));
    CHECK(arming_arm(&a, 0U, 7U, actuator, NOW));

    /* A frame of pulses and a turn of the loop are left of the 50 ms. */
    const uint32_t silence_us = ARMING_SAFE_US - ARMING_TURN_US - actuator.frame_us;
    CHECK(arming_keepalive(&a, 7U, NOW + silence_us));
    CHECK(!arming_keepalive(&a, 8U, NOW + silence_us + 1000U)); /* a stranger's */
    arming_poll(&a, 0U, NOW + 2U * silence_us);
    CHECK(a.armed);
    CHECK(!arming_keepalive(&a, 7U, NOW + 2U * silence_us + 1U)); /* comes before the poll, and late */
    CHECK(!a.armed && a.cause == ARMING_BLOCK_SILENCE);

    CHECK(arming_arm(&a, 0U, 7U, actuator, NOW));
    arming_poll(&a, GONE, NOW);
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!a.armed && a.cause == GONE); /* the first cause stays */
    arming_poll(&a, 0U, NOW);
    CHECK(!a.armed); /* latched */
}

static void hold(void) {
    arming_t a;
    arming_init(&a);
    CHECK(arming_arm(&a, 0U, 7U, actuator, NOW));
    arming_poll(&a, 0U, NOW + actuator.hold_us - 1U);
    CHECK(!a.driving);
    arming_poll(&a, 0U, NOW + actuator.hold_us);
    CHECK(a.driving);

    /* 71.6 minutes after arming the difference is small again: no second hold in the middle of a flight. */
    uint32_t now_us = NOW;
    for (uint32_t i = 0U; i < UINT32_MAX / 40000U + 100U; i++) {
        now_us += 40000U;
        CHECK(arming_keepalive(&a, 7U, now_us));
        arming_poll(&a, 0U, now_us);
        CHECK(a.driving);
    }
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!a.driving);
}

/* Seen open, then closed, each for long enough; returns when. */
static uint32_t close_switch(arming_t *a) {
    uint32_t now_us = NOW;
    CHECK(!arming_switch(a, false, now_us));
    now_us += ARMING_SWITCH_US;
    CHECK(!arming_switch(a, false, now_us));
    CHECK(!arming_switch(a, true, now_us));
    now_us += ARMING_SWITCH_US;
    CHECK(arming_switch(a, true, now_us));
    CHECK(!arming_switch(a, true, now_us)); /* one closing counts once */
    return now_us;
}

static void handle(void) {
    arming_t a;
    arming_init(&a);
    uint32_t now_us = close_switch(&a);
    arming_try_switch(&a, GONE, actuator, now_us);
    CHECK(!a.armed);
    arming_try_switch(&a, ARMING_BLOCKS_HOST, actuator, now_us + ARMING_SWITCH_TRY_US);
    CHECK(a.armed && a.by_switch); /* what concerns a host alone is not in its way */
    CHECK(!arming_switch(&a, false, now_us + ARMING_SWITCH_TRY_US + 1U));
    CHECK(!a.armed && a.cause == ARMING_BLOCK_SWITCH); /* the first look that finds it open */

    arming_init(&a);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, actuator, now_us + ARMING_SWITCH_TRY_US);
    arming_try_switch(&a, 0U, actuator, now_us + ARMING_SWITCH_TRY_US + 1U);
    CHECK(!a.armed); /* what was in the way went too late */

    arming_init(&a);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, actuator, now_us);
    CHECK(!arming_switch(&a, false, now_us + 1000U));
    arming_try_switch(&a, 0U, actuator, now_us + 1000U);
    CHECK(!a.armed); /* let go before it went */
}

int main(void) {
    keep_alives();
    hold();
    handle();
    return check_failures != 0;
}
