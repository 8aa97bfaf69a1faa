/* The library's functions give what the kernels that the core inlines give, on any input. */
#include "check.h"
#include "core/angle.h"
#include "core/calibration.h"
#include "core/kalman.h"
#include "core/pid.h"
#include "core/tilt.h"
#include "core/wheel.h"
#include <string.h>

static void angles(void) {
    for (int i = 0; i < 20000; i++) {
        const int32_t y = check_random_wild(), x = check_random_wild();
        CHECK(plumb_angle_atan2(y, x) == angle_atan2(y, x));
        CHECK(plumb_angle_asin(x) == angle_asin(x));
    }
}

static void calibrations(void) {
    const plumb_calibration_params_t p = {100, 4000, 67584, -138412032};
    for (int32_t raw = 0; raw < 4096; raw++) {
        uint32_t flags = 0;
        bool clamped = false, kept = true;
        const int32_t value = calibration_apply(&p, raw, &flags, 4U);
        CHECK(plumb_calibration_apply(&p, raw, &clamped) == value && clamped == (flags == 4U));
        CHECK(plumb_calibration_apply(&p, raw, &kept) == value && kept);
    }
}

static void tilts(void) {
    plumb_tilt_params_t p = {PLUMB_TILT_ATAN2, 9321, 10252743, 9320676, 499640, 13};
    CHECK(plumb_tilt_valid(&p));
    for (int i = 0; i < 10000; i++) {
        const int32_t y = check_random_wild() >> 2, z = check_random_wild() >> 2;
        p.mode = (uint32_t)i & 1U;
        CHECK(plumb_tilt_angle(&p, y, z) == tilt_angle(&p, y, z));
        CHECK(plumb_tilt_variance(&p, y, z) == tilt_variance(&p, y, z));
    }
}

/* The parameters are the factory values of the table, at 20 ms. */
static void filters(void) {
    const plumb_kalman_params_t p = {.dt_s_q33 = 171798692,
                                     .qa_hi = 2,
                                     .qa_lo = 1017744613,
                                     .qb = 512409,
                                     .qb_frac_q30 = 598721709,
                                     .bias_max_turn_q29 = 8947849,
                                     .rate_gain = 1677721600,
                                     .rate_shift = 6};
    const plumb_kalman_start_t start = {.p00_hi = 33554432, .p11_hi = 1491, .p11_lo = 1323231702};
    CHECK(plumb_kalman_valid(&p, &start));
    plumb_kalman_t a, b;
    plumb_kalman_init(&a, &start);
    plumb_kalman_init(&b, &start);
    for (int i = 0; i < 10000; i++) {
        const uint32_t r = 1U + check_random() % PLUMB_KALMAN_R_MAX;
        const int32_t tilt = check_random_wild(), rate = check_random_wild() >> 1;
        CHECK(plumb_kalman_predicted(&a, &p, rate) == kalman_predicted(&b, &p, rate));
        plumb_kalman_step(&a, &p, r, tilt, rate);
        kalman_step(&b, &p, r, tilt, rate);
        CHECK(memcmp(&a, &b, sizeof a) == 0);
        CHECK(plumb_kalman_tilt(&a) == kalman_tilt(&b) && plumb_kalman_bias(&a, &p) == kalman_bias(&b, &p));
    }
}

static void controllers(void) {
    const plumb_pid_params_t p = {67947725, 3623879, 410706248, 2108151113, 1677722};
    const plumb_wheel_params_t wheel = {40, 25099, 103937842, 11000000};
    CHECK(plumb_pid_valid(&p) && plumb_wheel_valid(&wheel));
    plumb_pid_t a, b;
    plumb_pid_init(&a);
    plumb_pid_init(&b);
    plumb_wheel_t one = {0}, other = {0};
    for (int i = 0; i < 10000; i++) {
        const int32_t error = check_random_wild(), rate = check_random_wild() >> 1;
        plumb_pid_step(&a, &p, error, rate);
        pid_step(&b, &p, error, rate);
        CHECK(memcmp(&a, &b, sizeof a) == 0);
        const int32_t edges = check_random_wild() >> 20;
        CHECK(plumb_wheel_step(&one, &wheel, edges) == wheel_step(&other, &wheel, edges));
        CHECK(memcmp(&one, &other, sizeof one) == 0);
    }
}

int main(void) {
    angles();
    calibrations();
    tilts();
    filters();
    controllers();
    return check_failures != 0;
}
