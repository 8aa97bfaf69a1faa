/* Who may move the actuator: keep-alives and the hold, with the clock about to wrap. */
#include "check.h"
#include "link/arming.h"

#define NOW  0xFFFFF000U /* 4 ms before the clock wraps */
#define GONE 0x0008U     /* something that blocks */

static const uint32_t hold_us = 40000U;

static random_t chance = {1U};

/* A value counts once and for KEEPALIVE_LIFE_US; values are issued in step with the clock. */
static void values(void) {
    keepalive_t k;
    keepalive_begin(&k, NOW);
    const uint32_t first = keepalive_issue(&k, &chance, NOW); /* due at once */
    CHECK(first != 0U && !keepalive_counts(&k, 0U, NOW));
    CHECK(keepalive_issue(&k, &chance, NOW + KEEPALIVE_PERIOD_US - 1U) == 0U);
    const uint32_t second = keepalive_issue(&k, &chance, NOW + KEEPALIVE_PERIOD_US + 900U);
    CHECK(second != 0U && second != first);
    CHECK(keepalive_issue(&k, &chance, NOW + KEEPALIVE_PERIOD_US + 900U) == 0U);
    const uint32_t third = keepalive_issue(&k, &chance, NOW + 2U * KEEPALIVE_PERIOD_US);
    CHECK(third != 0U);
    CHECK(!keepalive_counts(&k, third ^ 1U, NOW + KEEPALIVE_LIFE_US)); /* a stranger's */
    CHECK(keepalive_counts(&k, third, NOW + KEEPALIVE_LIFE_US));
    CHECK(!keepalive_counts(&k, third, NOW + KEEPALIVE_LIFE_US)); /* once */
    CHECK(!keepalive_counts(&k, 0U, NOW + KEEPALIVE_LIFE_US));    /* what stands in its place then */
    CHECK(keepalive_counts(&k, first, NOW + KEEPALIVE_LIFE_US));  /* in any order, as late as that */
    CHECK(!keepalive_counts(&k, second, NOW + KEEPALIVE_PERIOD_US + 900U + KEEPALIVE_LIFE_US + 1U));
    CHECK(keepalive_issue(&k, &chance, NOW + 1000000U) != 0U); /* after a gap: one, and no more */
    CHECK(keepalive_issue(&k, &chance, NOW + 1000000U) == 0U);

    keepalive_begin(&k, NOW);
    const uint32_t old = keepalive_issue(&k, &chance, NOW);
    keepalive_begin(&k, NOW);
    CHECK(!keepalive_counts(&k, old, NOW)); /* of the armed time before */
}

static void keep_alives(void) {
    arming_t a;
    arming_init(&a, 0x12345678U);
    CHECK(!arming_arm(&a, GONE, hold_us, NOW));
    CHECK(!arming_keepalive(&a, a.number, 0U, NOW) && arming_issue(&a, &chance, NOW) == 0U);
    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    uint32_t value = arming_issue(&a, &chance, NOW);
    CHECK(value != 0U);

    const uint32_t silence_us = ARMING_SILENCE_US;
    CHECK(arming_keepalive(&a, a.number, value, NOW + KEEPALIVE_LIFE_US));
    value = arming_issue(&a, &chance, NOW + KEEPALIVE_LIFE_US + 9000U);
    CHECK(value != 0U && !arming_keepalive(&a, a.number, value + 1U, NOW + KEEPALIVE_LIFE_US + 9000U));
    arming_poll(&a, 0U, NOW + KEEPALIVE_LIFE_US + silence_us);
    CHECK(arming_armed(&a));
    CHECK(!arming_keepalive(&a, a.number, value,
                            NOW + KEEPALIVE_LIFE_US + silence_us + 1U)); /* before the poll, late */
    arming_poll(&a, 0U, NOW + KEEPALIVE_LIFE_US + silence_us + 1U);
    CHECK(!arming_armed(&a) && a.cause == ARMING_BLOCK_SILENCE);

    /* After a pause of the loop a keep-alive is late because of the pause, which the poll knows. */
    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    value = arming_issue(&a, &chance, NOW);
    CHECK(arming_keepalive(&a, a.number, value, NOW));
    value = arming_issue(&a, &chance, NOW + KEEPALIVE_PERIOD_US);
    CHECK(value != 0U && !arming_keepalive(&a, a.number, value, NOW + silence_us + 1U));
    arming_poll(&a, ARMING_BLOCK_FAULT, NOW + silence_us + 1U);
    CHECK(!arming_armed(&a) && a.cause == ARMING_BLOCK_FAULT);

    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    arming_poll(&a, GONE, NOW);
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!arming_armed(&a) && a.cause == GONE); /* the first cause stays */
    arming_poll(&a, 0U, NOW);
    CHECK(!arming_armed(&a)); /* latched */
}

/* A host whose arming is over holds no later one, whatever value it sends back. */
static void numbers(void) {
    arming_t a;
    arming_init(&a, UINT32_MAX); /* the number before was the largest: 0 is left out */
    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    CHECK(a.number == 1U);
    const uint32_t old = arming_issue(&a, &chance, NOW);
    CHECK(arming_arm(&a, 0U, hold_us, NOW)); /* anew, without a disarming in between */
    CHECK(a.number == 2U);
    const uint32_t value = arming_issue(&a, &chance, NOW);
    CHECK(value != 0U && !arming_keepalive(&a, 1U, value, NOW)); /* the old host answers the new value, */
    CHECK(!arming_keepalive(&a, 0U, value, NOW));                /* a host before version 3 as well, */
    CHECK(!arming_keepalive(&a, 2U, old, NOW));  /* and this is a value of the arming before */
    CHECK(arming_keepalive(&a, 2U, value, NOW)); /* none of them has used it up */
    const uint32_t last = arming_issue(&a, &chance, NOW + KEEPALIVE_PERIOD_US);
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(a.number == 2U && last != 0U && !arming_keepalive(&a, 2U, last, NOW + KEEPALIVE_PERIOD_US));
    CHECK(arming_issue(&a, &chance, NOW + 2U * KEEPALIVE_PERIOD_US) == 0U);
}

static void hold(void) {
    arming_t a;
    arming_init(&a, 0x12345678U);
    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    arming_poll(&a, 0U, NOW + hold_us - 1U);
    CHECK(!arming_driving(&a));
    arming_poll(&a, 0U, NOW + hold_us);
    CHECK(arming_driving(&a));

    /* 71.6 minutes after arming the difference is small again: no second hold in the middle of a flight. */
    uint32_t now_us = NOW + hold_us;
    (void)arming_keepalive(&a, a.number, arming_issue(&a, &chance, now_us), now_us);
    for (uint32_t i = 0U; i < UINT32_MAX / 10000U + 100U; i++) {
        now_us += 10000U;
        CHECK(arming_keepalive(&a, a.number, arming_issue(&a, &chance, now_us), now_us));
        arming_poll(&a, 0U, now_us);
        CHECK(arming_driving(&a));
    }
    CHECK(arming_arm(&a, 0U, hold_us, now_us)); /* anew while it drives: the hold begins again */
    CHECK(!arming_driving(&a));
    arming_poll(&a, 0U, now_us + hold_us);
    CHECK(arming_driving(&a));
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    CHECK(!arming_driving(&a) && a.armed.word != ARMING_ARMED && a.driving.word != ARMING_DRIVING);
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
    arming_init(&a, 0x12345678U);
    CHECK(arming_arm(&a, 0U, hold_us, NOW));
    const uint32_t value = arming_issue(&a, &chance, NOW); /* of a host that armed before */
    arming_disarm(&a, ARMING_BLOCK_COMMAND);
    uint32_t now_us = close_switch(&a);
    arming_try_switch(&a, GONE, ARMING_SWITCH_READY_US, hold_us, now_us);
    CHECK(!arming_armed(&a));
    arming_try_switch(&a, ARMING_BLOCKS_HOST, ARMING_SWITCH_READY_US, hold_us, now_us + ARMING_SWITCH_TRY_US);
    CHECK(arming_armed(&a) && a.by_switch);             /* what concerns a host alone is not in its way */
    CHECK(!arming_keepalive(&a, a.number, value, NOW)); /* nor does one hold it */
    CHECK(arming_issue(&a, &chance, now_us + ARMING_SWITCH_TRY_US) == 0U);
    CHECK(!arming_switch(&a, false, now_us + ARMING_SWITCH_TRY_US + 1U));
    CHECK(!arming_armed(&a) && a.cause == ARMING_BLOCK_SWITCH); /* the first look that finds it open */

    arming_init(&a, 0x12345678U);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, ARMING_SWITCH_READY_US, hold_us, now_us + ARMING_SWITCH_TRY_US);
    arming_try_switch(&a, 0U, ARMING_SWITCH_READY_US, hold_us, now_us + ARMING_SWITCH_TRY_US + 1U);
    CHECK(!arming_armed(&a)); /* what was in the way went too late */

    arming_init(&a, 0x12345678U);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, ARMING_SWITCH_READY_US, hold_us, now_us);
    arming_try_switch(&a, ARMING_BLOCK_NOT_READY, ARMING_SWITCH_READY_US, hold_us,
                      now_us + ARMING_SWITCH_TRY_US);
    arming_try_switch(&a, ARMING_BLOCK_NOT_READY, ARMING_SWITCH_READY_US, hold_us,
                      now_us + ARMING_SWITCH_READY_US - 1U);
    CHECK(!arming_armed(&a) && a.switch_trying); /* a run that has just begun is not ready for a while */
    arming_try_switch(&a, 0U, ARMING_SWITCH_READY_US, hold_us, now_us + ARMING_SWITCH_READY_US);
    CHECK(arming_armed(&a));

    arming_init(&a, 0x12345678U);
    now_us = close_switch(&a);
    arming_try_switch(&a, ARMING_BLOCK_NOT_READY, ARMING_SWITCH_READY_US, hold_us,
                      now_us + ARMING_SWITCH_TRY_US + 1U);
    arming_try_switch(&a, GONE | ARMING_BLOCK_NOT_READY, ARMING_SWITCH_READY_US, hold_us,
                      now_us + ARMING_SWITCH_TRY_US + 2U);
    arming_try_switch(&a, 0U, ARMING_SWITCH_READY_US, hold_us, now_us + ARMING_SWITCH_TRY_US + 3U);
    CHECK(!arming_armed(&a)); /* a fault meanwhile ends the waiting */

    arming_init(&a, 0x12345678U);
    now_us = close_switch(&a);
    arming_try_switch(&a, GONE, ARMING_SWITCH_READY_US, hold_us, now_us);
    CHECK(!arming_switch(&a, false, now_us + 1000U));
    arming_try_switch(&a, 0U, ARMING_SWITCH_READY_US, hold_us, now_us + 1000U);
    CHECK(!arming_armed(&a)); /* let go before it went */
}

/* No flipped bit arms, and every one disarms. */
static void flipped_words(void) {
    for (unsigned bit = 0; bit < 32U; bit++) {
        arming_t a;
        arming_init(&a, 0x12345678U);
        CHECK(!arming_armed(&a) && !arming_driving(&a));
        a.armed.word ^= 1U << bit;
        a.driving.word ^= 1U << bit;
        CHECK(!arming_armed(&a) && !arming_driving(&a));

        arming_init(&a, 0x12345678U);
        CHECK(arming_arm(&a, 0U, 0U, NOW));
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
    values();
    keep_alives();
    numbers();
    hold();
    handle();
    return check_failures != 0;
}
