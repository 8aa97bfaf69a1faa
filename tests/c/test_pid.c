/* The controller: each term by hand, every limit, and an integral that cannot wind up. */
#include "check.h"
#include "core/pid.h"
#include <stdlib.h>

#define ONE      (1 << 22)
#define NO_LIMIT (1 << 23)

static plumb_pid_t started(void) {
    plumb_pid_t c;
    plumb_pid_init(&c);
    return c;
}

/* kp 2 per turn on 1/16 turn: 1/8. kd 1/4 per turn/s on 1/2 turn/s: -1/8, against the rate. ki dt 1/2 on
 * 1/16: 1/32. */
static void terms(void) {
    plumb_pid_params_t p = {.kp_q22 = 2 * ONE, .d_alpha_q31 = INT32_MAX, .slew_q22 = NO_LIMIT};
    plumb_pid_t c = started();
    pid_step(&c, &p, 1 << 28, 0);
    CHECK(c.command_q22 == ONE / 8 && c.excess_q22 == 0 && c.integral_q54 == 0);
    pid_step(&c, &p, -(1 << 28), 0);
    CHECK(c.command_q22 == -ONE / 8);

    p = (plumb_pid_params_t){.kd_q27 = 1 << 25, .d_alpha_q31 = INT32_MAX, .slew_q22 = NO_LIMIT};
    c = started();
    pid_step(&c, &p, 0, 1 << 27);
    CHECK(abs(c.rate_filtered_turnps_q27 - (1 << 26)) <= 2);
    CHECK(abs(c.command_q22 + ONE / 8) <= 1);

    p = (plumb_pid_params_t){.ki_dt_q22 = ONE / 2, .slew_q22 = NO_LIMIT};
    c = started();
    pid_step(&c, &p, 1 << 28, 0);
    CHECK(c.command_q22 == 0 && c.integral_q54 == (int64_t)ONE / 32 * 4294967296);
    pid_step(&c, &p, 1 << 28, 0);
    CHECK(c.command_q22 == ONE / 32);
}

/* A D filter of 1/4 per step covers 1 - (3/4)^8 of a jump in 8 steps: 0.89989. */
static void filter(void) {
    const plumb_pid_params_t p = {.d_alpha_q31 = 1 << 29, .slew_q22 = NO_LIMIT};
    plumb_pid_t c = started();
    for (int i = 0; i < 8; i++) {
        pid_step(&c, &p, 0, 1 << 28);
    }
    CHECK(abs(c.rate_filtered_turnps_q27 - 120780800) <= 20);
    for (int i = 0; i < 200; i++) {
        pid_step(&c, &p, 0, 1 << 28);
    }
    CHECK(abs(c.rate_filtered_turnps_q27 - (1 << 27)) <= 8);
}

/* Saturates at both ends, never wraps: half a turn of error at the largest gain. */
static void output_limit(void) {
    const plumb_pid_params_t p = {.kp_q22 = 1 << 30, .slew_q22 = NO_LIMIT};
    plumb_pid_t c = started();
    pid_step(&c, &p, INT32_MAX, 0);
    CHECK(c.command_q22 == ONE - 1 && c.excess_q22 > 0);
    pid_step(&c, &p, INT32_MIN, 0);
    CHECK(c.command_q22 == -ONE && c.excess_q22 < 0);
}

static void slew_limit(void) {
    const plumb_pid_params_t p = {.kp_q22 = 1 << 30, .slew_q22 = 1000};
    plumb_pid_t c = started();
    for (int i = 1; i <= 5; i++) {
        pid_step(&c, &p, 1 << 30, 0);
        CHECK(c.command_q22 == 1000 * i);
    }
    pid_step(&c, &p, -(1 << 30), 0);
    CHECK(c.command_q22 == 4000);
}

/* Held against the limit for long, the integral stays what it was; it leaves at once when the error turns. */
static void no_windup(void) {
    const plumb_pid_params_t p = {.kp_q22 = 16 * ONE, .ki_dt_q22 = ONE / 4, .slew_q22 = NO_LIMIT};
    plumb_pid_t c = started();
    for (int i = 0; i < 1000; i++) {
        pid_step(&c, &p, 1 << 29, 0); /* demand 2 */
    }
    CHECK(c.command_q22 == ONE - 1 && c.integral_q54 == 0);
    pid_step(&c, &p, -(1 << 20), 0);
    CHECK(c.command_q22 < 0 && c.integral_q54 < 0);

    /* an integral already beyond the limit is allowed back, although the command is limited */
    c.integral_q54 = (int64_t)ONE * 3 / 2 * 4294967296;
    pid_step(&c, &p, -(1 << 20), 0);
    CHECK(c.excess_q22 > 0 && c.integral_q54 < (int64_t)ONE * 3 / 2 * 4294967296);
    const int64_t before = c.integral_q54;
    pid_step(&c, &p, 1 << 20, 0);
    CHECK(c.excess_q22 > 0 && c.integral_q54 == before);
}

/* kp 2 on 1/16 turn, kd 1/4 on 1/2 turn/s and an integral of 1/32: other gains leave the demand of the same
 * error and rate as it was, to the last bit. */
static void other_gains(void) {
    const plumb_pid_params_t from = {.kp_q22 = 2 * ONE,
                                     .ki_dt_q22 = ONE / 2,
                                     .kd_q27 = 1 << 25,
                                     .d_alpha_q31 = INT32_MAX,
                                     .slew_q22 = NO_LIMIT};
    plumb_pid_params_t to = from;
    plumb_pid_t c = started(), same;
    c.error_turn_q32 = 1 << 28;
    pid_step(&c, &from, c.error_turn_q32, 1 << 27);
    to.kp_q22 = 3 * ONE;
    to.kd_q27 = 3 << 23;
    same = c;
    plumb_pid_retune(&c, &from, &to);
    /* 1/8 - 3/16 of the error, less (1/8 - 3/32) of the rate */
    CHECK(abs((int32_t)((c.integral_q54 - same.integral_q54) >> 32) + ONE / 16 + ONE / 32) <= 1);
    CHECK((uint32_t)c.integral_q54 == (uint32_t)same.integral_q54);
    pid_step(&same, &from, c.error_turn_q32, 2 * c.rate_filtered_turnps_q27);
    plumb_pid_t after = c;
    pid_step(&after, &to, c.error_turn_q32, 2 * c.rate_filtered_turnps_q27);
    CHECK(after.command_q22 == same.command_q22 && after.excess_q22 == same.excess_q22);

    /* no integral gain: nothing moves, because no step would take it away again */
    to.ki_dt_q22 = 0;
    same = c;
    plumb_pid_retune(&c, &from, &to);
    CHECK(c.integral_q54 == same.integral_q54);

    /* before the first step there is no error and no rate */
    c = started();
    plumb_pid_retune(&c, &to, &from);
    CHECK(c.integral_q54 == 0);

    /* the largest change there is, to either side: the integral is limited, and nothing overflows */
    const plumb_pid_params_t most = {.kp_q22 = 1 << 30, .ki_dt_q22 = 1, .kd_q27 = -(1 << 30), .slew_q22 = 1};
    const plumb_pid_params_t least = {.kp_q22 = -(1 << 30), .ki_dt_q22 = 1, .kd_q27 = 1 << 30, .slew_q22 = 1};
    c.error_turn_q32 = c.rate_filtered_turnps_q27 = INT32_MIN;
    plumb_pid_retune(&c, &least, &most);
    CHECK(c.integral_q54 >> 32 == 2 * ONE - 1);
    plumb_pid_retune(&c, &most, &least);
    CHECK(c.integral_q54 >> 32 == -2 * ONE);
}

/* A last command out of range, by a flipped bit, would be full command for as long as slew takes to come
 * back. */
static void flipped_command(void) {
    const plumb_pid_params_t p = {.kp_q22 = ONE, .d_alpha_q31 = INT32_MAX, .slew_q22 = 1000};
    for (unsigned bit = 0; bit < 32U; bit++) {
        plumb_pid_t c = started();
        c.command_q22 = (int32_t)(1U << bit);
        pid_step(&c, &p, 0, 0);
        CHECK(c.command_q22 >= -ONE && c.command_q22 < ONE);
        const int32_t first = c.command_q22;
        pid_step(&c, &p, 0, 0);
        CHECK(abs(c.command_q22) <= abs(first) && abs(c.command_q22 - first) <= 1000);
    }
}

static void never(void) {
    for (int run = 0; run < 1000; run++) {
        const plumb_pid_params_t p = {.kp_q22 = check_random_wild() / 2,
                                      .ki_dt_q22 = check_random_wild() & INT32_MAX,
                                      .kd_q27 = check_random_wild() / 2,
                                      .d_alpha_q31 = check_random_wild() & INT32_MAX,
                                      .slew_q22 =
                                          1 + (int32_t)(check_random() >> (9 + check_random() % 20U))};
        CHECK(plumb_pid_valid(&p));
        plumb_pid_t c = started();
        for (int i = 0; i < 200; i++) {
            const int32_t last = c.command_q22;
            pid_step(&c, &p, check_random_wild(), check_random_wild());
            CHECK(c.command_q22 >= -ONE && c.command_q22 < ONE);
            CHECK(abs(c.command_q22 - last) <= p.slew_q22);
            CHECK(c.integral_q54 >= -2LL * ONE * 4294967296 && c.integral_q54 < 2LL * ONE * 4294967296);
        }
    }
}

static void refuses(void) {
    const plumb_pid_params_t good = {.slew_q22 = 1};
    plumb_pid_params_t p = good;
    CHECK(plumb_pid_valid(&p));
    p.slew_q22 = 0;
    CHECK(!plumb_pid_valid(&p));
    p = good;
    p.ki_dt_q22 = -1;
    CHECK(!plumb_pid_valid(&p));
    p = good;
    p.kp_q22 = (1 << 30) + 1;
    CHECK(!plumb_pid_valid(&p));
    p = good;
    p.d_alpha_q31 = -1;
    CHECK(!plumb_pid_valid(&p));
}

int main(void) {
    terms();
    filter();
    output_limit();
    slew_limit();
    no_windup();
    other_gains();
    flipped_command();
    never();
    refuses();
    return check_failures != 0;
}
