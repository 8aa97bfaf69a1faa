/* Which step numbers make a setpoint count, with the numbers about to wrap. */
#include "check.h"
#include "link/setpoint.h"

#define PERIOD_US 5000U
#define FRESH     (SETPOINT_SILENCE_US / PERIOD_US) /* steps */

/* So many steps without a setpoint. */
static void steps(setpoint_t *s, uint32_t count) {
    static routing_t nobody;
    s->waiting = false;
    for (uint32_t i = 0; i < count; i++) {
        setpoint_report(s, &nobody, LINK_UART, 0);
    }
}

static void first_of_a_run(void) {
    setpoint_t s = {0};
    setpoint_begin(&s, NULL);
    CHECK(setpoint_age(&s, 0U, 0U, PERIOD_US) == SETPOINT_COUNTS);
    CHECK(setpoint_age(&s, 0U, FRESH - 1U, PERIOD_US) == SETPOINT_COUNTS);
    CHECK(setpoint_age(&s, 0U, FRESH, PERIOD_US) == SETPOINT_OLD);
    CHECK(setpoint_age(&s, 1U, 0U, PERIOD_US) == SETPOINT_OLD); /* still to come */
    CHECK(setpoint_age(&s, 0xFFFFU, 0U, PERIOD_US) == SETPOINT_COUNTS);
}

static void newer_than_the_last(void) {
    for (uint32_t at = 0xFF00U; at < 0x10100U; at++) {
        const uint16_t now = (uint16_t)at;
        setpoint_t s = {0};
        setpoint_begin(&s, NULL);
        setpoint_number(&s, now);
        CHECK(setpoint_age(&s, now, now, PERIOD_US) == SETPOINT_REPEATED);
        CHECK(setpoint_age(&s, now, (uint16_t)(now + 1000U), PERIOD_US) == SETPOINT_REPEATED);
        CHECK(setpoint_age(&s, (uint16_t)(now - 1U), now, PERIOD_US) == SETPOINT_OLD);
        CHECK(setpoint_age(&s, (uint16_t)(now + 1U), (uint16_t)(now + 1U), PERIOD_US) == SETPOINT_COUNTS);
        CHECK(setpoint_age(&s, (uint16_t)(now + 1U), (uint16_t)(now + FRESH), PERIOD_US) == SETPOINT_COUNTS);
        CHECK(setpoint_age(&s, (uint16_t)(now + 1U), (uint16_t)(now + 1U + FRESH), PERIOD_US) ==
              SETPOINT_OLD);
    }
}

/* From 0.5 to 100 ms: a source that answers each step at once always counts. */
static void periods(void) {
    static const uint32_t period_us[] = {500U, 1000U, 2500U, 5000U, 20000U, 100000U};
    for (unsigned i = 0; i < sizeof period_us / sizeof *period_us; i++) {
        setpoint_t s = {0};
        setpoint_begin(&s, NULL);
        for (uint32_t step = 0; step < 70000U; step++) {
            CHECK(setpoint_age(&s, (uint16_t)step, (uint16_t)(step + 1U), period_us[i]) == SETPOINT_COUNTS);
            setpoint_number(&s, (uint16_t)step);
            steps(&s, 1U);
        }
    }
}

/* A source that comes back after any time counts; a single frame that is still repeated never does. */
static void after_silence(void) {
    static const uint32_t silent[] = {0x7FFEU, 0x7FFFU, 0x8000U, 0x9000U, 0xFFFEU, 0x10000U, 0x18000U};
    for (unsigned i = 0; i < sizeof silent / sizeof *silent; i++) {
        setpoint_t s = {0};
        setpoint_begin(&s, NULL);
        setpoint_number(&s, 0x1234U);
        for (uint32_t step = 1U; step <= silent[i]; step++) {
            steps(&s, 1U);
            CHECK(setpoint_age(&s, 0x1234U, (uint16_t)(0x1234U + step), PERIOD_US) != SETPOINT_COUNTS);
        }
        const uint16_t now = (uint16_t)(0x1234U + silent[i]);
        const setpoint_age_t age = setpoint_age(&s, now, now, PERIOD_US);
        CHECK(age == (now == 0x1234U ? SETPOINT_REPEATED : SETPOINT_COUNTS));
        CHECK(setpoint_age(&s, (uint16_t)(now + 1U), (uint16_t)(now + 1U), PERIOD_US) == SETPOINT_COUNTS);
    }
}

/* Disarming ends the setpoint, and one that is still on its way does not count any more. */
static void ends_with_the_arming(void) {
    setpoint_t s = {0};
    setpoint_begin(&s, NULL);
    setpoint_poll(&s, true, true, 10U, 0U);
    setpoint_receive(&s, 1 << 24);
    setpoint_poll(&s, true, true, 10U, 1000U);
    CHECK(s.value == 1 << 24);
    setpoint_poll(&s, false, false, 11U, 2000U);
    CHECK(s.value == 0);
    CHECK(setpoint_age(&s, 11U, 11U, PERIOD_US) == SETPOINT_REPEATED);
    CHECK(setpoint_age(&s, 12U, 12U, PERIOD_US) == SETPOINT_COUNTS);
}

int main(void) {
    first_of_a_run();
    newer_than_the_last();
    periods();
    after_silence();
    ends_with_the_arming();
    return check_failures != 0;
}
