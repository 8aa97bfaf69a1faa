/* When a step of a run is overdue, and which tags follow each other, with the clock about to wrap. */
#include "check.h"
#include "generated/messages.h"
#include "link/run.h"

#define NOW 0xFFFFF000U /* 4 ms before the clock wraps */

static run_buffers_t buffers;
static params_t params;

static void begin(run_t *r, uint16_t run) {
    run_begin(r, run, (run_links_t){LINK_UART, LINK_UART, LINK_UART}, control_system(&params.control));
}

/* After the greater of 20 ms and 3 periods, counted from the begin and from each step. */
static void overdue(void) {
    static const struct {
        uint32_t period_us, limit_us;
    } of[] = {{500U, 20000U}, {5000U, 20000U}, {6666U, 20000U}, {6667U, 20001U}, {20000U, 60000U}};
    for (unsigned i = 0; i < sizeof of / sizeof *of; i++) {
        const uint32_t period_us = of[i].period_us, limit_us = of[i].limit_us;
        run_t r;
        run_init(&r, &buffers, 0U);
        CHECK(!run_step_overdue(&r, period_us, NOW) &&
              !run_step_overdue(&r, period_us, NOW + 1000000U)); /* no run */
        begin(&r, MESSAGE_RUN_BEGIN_RUN_LOCKSTEP);
        CHECK(run_pop_begin(&r));
        CHECK(!run_step_overdue(&r, period_us, NOW) && !run_step_overdue(&r, period_us, NOW + 1000000U));
        begin(&r, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
        CHECK(!run_step_overdue(&r, period_us, NOW - 1000000U)); /* the timer is not set yet */
        CHECK(!run_step_overdue(&r, period_us, NOW));
        CHECK(run_pop_begin(&r));
        CHECK(!run_step_overdue(&r, period_us, NOW + limit_us));
        CHECK(run_step_overdue(&r, period_us, NOW + limit_us + 1U));
        run_stepped(&r, false);
        CHECK(!run_step_overdue(&r, period_us, NOW + limit_us + 2U)); /* it came after all */
        CHECK(!run_step_overdue(&r, period_us, NOW + 2U * limit_us + 2U));
        CHECK(run_step_overdue(&r, period_us, NOW + 2U * limit_us + 3U));
        run_end(&r);
        CHECK(!run_step_overdue(&r, period_us, NOW + 3U * limit_us));
    }
}

/* 1 to 15 in a circle: 0 is no run, and two runs in a row never have the same. */
static void tags(void) {
    run_t r;
    run_init(&r, &buffers, 0xE0000000U);
    CHECK(r.tag == 14U);
    begin(&r, MESSAGE_RUN_BEGIN_RUN_LOCKSTEP);
    CHECK(r.tag == 15U);
    for (unsigned i = 0; i < 32U; i++) {
        begin(&r, MESSAGE_RUN_BEGIN_RUN_LOCKSTEP);
        CHECK(r.tag == i % 15U + 1U);
    }
}

/* A run begins with nothing of the one before. */
static void anew(void) {
    run_t r;
    run_init(&r, &buffers, 0U);
    begin(&r, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
    r.queue_in = 3U;
    r.injected.begun = true;
    r.injected.silent = false;
    r.setpoint.value = 1 << 28;
    run_stepped(&r, false);
    begin(&r, MESSAGE_RUN_BEGIN_RUN_REALTIME_INJECTED);
    CHECK(r.step == 0U && !run_sample_waits(&r) && r.setpoint.value == 0 && run_injected(&r));
    CHECK(injected_stale(&r.injected)); /* no sample has come */
}

int main(void) {
    params_default(&params);
    overdue();
    tags();
    anew();
    return check_failures != 0;
}
