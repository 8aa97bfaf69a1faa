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
    CHECK(arming_armed(&a));
    CHECK(!arming_keepalive(&a, 7U, NOW + 2U * silence_us + 1U)); /* comes before the poll, and late */
    CHECK(!arming_armed(&a) && a.cause == ARMING_BLOCK_SILENCE);

    CHECK(arming_arm(&a, 0U, 7U, actuator, NOW));
    arming_poll(&a, GONE, NOW);
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!arming_armed(&a) && a.cause == GONE); /* the first cause stays */
    arming_poll(&a, 0U, NOW);
    CHECK(!arming_armed(&a)); /* latched */
}

static void hold(void) {
    arming_t a;
    arming_init(&a);
    CHECK(arming_arm(&a, 0U, 7U, actuator, NOW));
    arming_poll(&a, 0U, NOW + actuator.hold_us - 1U);
    CHECK(!arming_driving(&a));
    arming_poll(&a, 0U, NOW + actuator.hold_us);
    CHECK(arming_driving(&a));

    /* 71.6 minutes after arming the difference is small again: no second hold in the middle of a flight. */
    uint32_t now_us = NOW;
    for (uint32_t i = 0U; i < UINT32_MAX / 40000U + 100U; i++) {
        now_us += 40000U;
        CHECK(arming_keepalive(&a, 7U, now_us));
        arming_poll(&a, 0U, now_us);
        CHECK(arming_driving(&a));
    }
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!arming_driving(&a));
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
    CHECK(!arming_armed(&a));
    arming_try_switch(&a, ARMING_BLOCKS_HOST, actuator, now_us + ARMING_SWITCH_TRY_US);
    CHECK(arming_armed(&a) && a.by_switch); /* what concerns a host alone is not in its way */
    CHECK(!arming_switch(&a, false, now_us + ARMING_SWITCH_TRY_US + 1U));
    CHECK(!arming_armed(&a) && a.cause == ARMING_BLOCK_SWITCH); /* the first look that finds it open */

    arming_init(&a);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, actuator, now_us + ARMING_SWITCH_TRY_US);
    arming_try_switch(&a, 0U, actuator, now_us + ARMING_SWITCH_TRY_US + 1U);
    CHECK(!arming_armed(&a)); /* what was in the way went too late */

    arming_init(&a);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, actuator, now_us);
    CHECK(!arming_switch(&a, false, now_us + 1000U));
    arming_try_switch(&a, 0U, actuator, now_us + 1000U);
    CHECK(!arming_armed(&a)); /* let go before it went */
}

/* No flipped bit arms, and every one disarms. */
static void flipped_words(void) {
    for (unsigned bit = 0; bit < 32U; bit++) {
        arming_t a;
        arming_init(&a);
        CHECK(!arming_armed(&a) && !arming_driving(&a));
        a.armed.word ^= 1U << bit;
        a.driving.word ^= 1U << bit;
        CHECK(!arming_armed(&a) && !arming_driving(&a));

        arming_init(&a);
        CHECK(arming_arm(&a, 0U, 7U, (arming_actuator_t){20000U, 0U}, NOW));
        arming_poll(&a, 0U, NOW);
        CHECK(arming_armed(&a) && arming_driving(&a));
        a.driving.word ^= 1U << bit;
        CHECK(arming_armed(&a) && !arming_driving(&a));
        a.driving.word ^= 1U << bit;
        a.armed.word ^= 1U << bit;
        CHECK(!arming_armed(&a) && !arming_driving(&a));
        arming_poll(&a, 0U, NOW);
        a.armed.word ^= 1U << bit; /* flipped back: the poll in between has ended it */
        CHECK(!arming_driving(&a));
    }
}

int main(void) {
    flipped_words();
    keep_alives();
    hold();
    handle();
    return check_failures != 0;
}
