/* The filter: one step worked by hand, the printed equations in double, wrapping, and what no input may
 * break. */
#include "check.h"
#include "core/kalman.h"
#include <math.h>
#include <stdlib.h>

#define ONE_LSB_R 4294967296.0 /* lsb in one unit of r */

/* 50 Hz */
static plumb_kalman_params_t params(void) {
    return (plumb_kalman_params_t){.dt_s_q33 = 171798692,
                                   .qa_lo = 0,
                                   .bias_max_turn_q29 = 1 << 22,
                                   .rate_gain = 1677721600,
                                   .rate_shift = 6};
}

/* P = [[R, 0], [0, 0]], Q = 0: S = 2 R, K = [1/2, 0], and p00 becomes R/2. The tilt moves half of the way. */
static void by_hand(void) {
    const plumb_kalman_params_t p = params();
    const plumb_kalman_start_t start = {.p00_hi = 1000};
    plumb_kalman_t k;
    plumb_kalman_init(&k, &start);
    kalman_step(&k, &p, 1000, 1 << 30, 0); /* z a quarter turn */
    CHECK(k.innovation_turn_q32 == 1 << 30);
    CHECK(k.k0_q29 >= (1 << 28) - 2 && k.k0_q29 <= 1 << 28);
    CHECK(k.k1_q29 == 0);
    CHECK(kalman_tilt(&k) >= (1 << 29) - 4 && kalman_tilt(&k) <= 1 << 29);
    CHECK(fabs((double)k.p00 / (500.0 * ONE_LSB_R) - 1.0) < 1e-8);
    CHECK(k.p01 == 0 && k.p11 == 0 && k.bias_turn_q61 == 0);
}

/* A rate of 1 turn/s for 50 steps of 20 ms is a turn: back to 0, against a measurement that is not believed.
 */
static void integrates(void) {
    const plumb_kalman_params_t p = params();
    const plumb_kalman_start_t start = {.p00_hi = 0};
    plumb_kalman_t k;
    plumb_kalman_init(&k, &start);
    for (int i = 0; i < 50; i++) {
        kalman_step(&k, &p, PLUMB_KALMAN_R_MAX, 0, 1 << 28);
    }
    CHECK(kalman_tilt(&k) > -100 && kalman_tilt(&k) < 100);
    kalman_step(&k, &p, PLUMB_KALMAN_R_MAX, 0, 1 << 28);
    CHECK(kalman_tilt(&k) > 85899345 - 100 && kalman_tilt(&k) < 85899345 + 100); /* 1/50 turn */
}

/* From +170 to -170 degrees is 20 degrees forward. */
static void innovation_wraps(void) {
    const plumb_kalman_params_t p = params();
    const plumb_kalman_start_t start = {.tilt_turn_q32 = 2028178654, .p00_hi = 1000}; /* 170 deg */
    plumb_kalman_t k;
    plumb_kalman_init(&k, &start);
    CHECK(kalman_tilt(&k) == 2028178654);
    kalman_step(&k, &p, 1000, -2028178654, 0);
    CHECK(k.innovation_turn_q32 == 238609988);
    CHECK((uint32_t)kalman_tilt(&k) - 0x80000000U + 8U < 16U); /* 180 deg */
}

/* Equations (1) to (5) in double, on the same integers, with a variance that jumps 1000:1. */
static void equations(void) {
    plumb_kalman_params_t p = params();
    p.qa_hi = 24; /* the shipped ratio of noises: R = 100000, Q = 24, 0.00128 per step */
    p.qb = 5497558;
    const plumb_kalman_start_t start = {.p00_hi = 16000000, .p11_hi = 8000, .bias_lo = 0};
    plumb_kalman_t k;
    plumb_kalman_init(&k, &start);
    double tilt = 0, bias = 0, p00 = (double)k.p00, p01 = 0, p11 = (double)k.p11;
    double worst = 0;
    for (int i = 0; i < 200000; i++) {
        const uint32_t r = check_random() % 50U == 0U ? 10000000U : 10000U;
        const double motion = 0.45 * sin(i * 0.006); /* turn: within +-162 deg */
        const int32_t noise = (int32_t)check_random() >> 8;
        const int32_t z = (int32_t)(motion * ONE_LSB_R) + noise;
        const int32_t rate =
            (int32_t)(0.45 * 0.3 * cos(i * 0.006) * 268435456.0) + 14913081; /* and 20 deg/s */
        kalman_step(&k, &p, r, z, rate);

        const double prior01 = p01 - p11;
        const double prior00 = p00 - p01 - prior01 + 24 * ONE_LSB_R;
        const double s = prior00 + r * ONE_LSB_R;
        const double k0 = prior00 / s, k1 = prior01 / s;
        tilt += rate / 268435456.0 * (p.dt_s_q33 / 8589934592.0) - bias;
        double innovation = z / ONE_LSB_R - tilt;
        innovation -= floor(innovation + 0.5);
        tilt += k0 * innovation;
        bias += k1 * innovation;
        p00 = r * ONE_LSB_R * k0;
        p01 = prior01 * (1 - k0);
        p11 += 5497558 - k1 * prior01;

        double error = kalman_tilt(&k) / ONE_LSB_R - tilt;
        error -= floor(error + 0.5);
        worst = fmax(worst, fabs(error) * 360.0);
    }
    CHECK(worst < 2e-5); /* deg */
    /* cutting bits off without care shows here first */
    CHECK(fabs((double)k.p00 / p00 - 1) < 2e-6 && fabs((double)k.p11 / p11 - 1) < 2e-6);
    CHECK(fabs((double)k.bias_turn_q61 / 2305843009213693952.0 / bias - 1) < 1e-8);
    CHECK(abs(kalman_bias(&k, &p) - (int32_t)(bias * 50 * 268435456.0)) < 2000);
}

/* Noise below 1 lsb per step is not lost: 1000 steps of 1/2 and 1/4 lsb, nothing measured. */
static void fractions(void) {
    plumb_kalman_params_t p = params();
    const plumb_kalman_start_t start = {.p00_hi = 0};
    plumb_kalman_t k;
    for (uint32_t shift = 1; shift <= 2; shift++) {
        p.qb_frac_q30 = 1U << (30U - shift);
        plumb_kalman_init(&k, &start);
        for (int i = 0; i < 1000; i++) {
            kalman_step(&k, &p, PLUMB_KALMAN_R_MAX, 0, 0);
        }
        CHECK(k.p11 == 1000 >> shift);
    }
}

/* Whatever comes in: variances keep their sign and range, gains stay between 0 and 1, the bias within its
 * limit. */
static void never(void) {
    for (int run = 0; run < 300; run++) {
        plumb_kalman_params_t p = params();
        p.qa_hi = check_random() >> (8 + check_random() % 24U);
        p.qa_lo = check_random();
        p.qb = check_random() >> (check_random() % 32U);
        p.qb_frac_q30 = check_random() >> 2;
        plumb_kalman_start_t s = {.p00_hi = check_random() >> (7 + check_random() % 25U),
                                  .p00_lo = check_random() >> 1,
                                  .p11_hi = check_random() >> (8 + check_random() % 24U)};
        s.p01_hi = -(int32_t)(s.p00_hi >> (1 + check_random() % 8U)) / 2;
        CHECK(plumb_kalman_valid(&p, &s));
        plumb_kalman_t k;
        plumb_kalman_init(&k, &s);
        for (int i = 0; i < 500; i++) {
            const uint32_t r = 1U + (check_random() >> (8 + check_random() % 24U));
            kalman_step(&k, &p, r, check_random_wild(), check_random_wild());
            CHECK(k.p00 > 0 && k.p00 <= (int64_t)1 << 56);
            CHECK(k.p11 >= 0 && k.p11 <= (int64_t)1 << 56);
            CHECK(k.p01 <= (int64_t)1 << 56 && k.p01 >= -((int64_t)1 << 57));
            CHECK(k.k0_q29 >= 0 && k.k0_q29 <= 1 << 29 && k.k1_q29 <= 1 << 29 && k.k1_q29 >= -(1 << 29));
            CHECK(k.p11_frac_q30 < 1U << 30);
            CHECK(k.bias_turn_q61 < (int64_t)1 << 58 && k.bias_turn_q61 >= -((int64_t)1 << 58));
            const int32_t bias = kalman_bias(&k, &p);
            CHECK(bias < 1 << 28 && bias > -(1 << 28));
        }
    }
}

static void refuses(void) {
    const plumb_kalman_start_t start = {.p00_hi = 1 << 24, .p11_hi = 1};
    plumb_kalman_params_t p = params();
    CHECK(plumb_kalman_valid(&p, &start));
    p.dt_s_q33 = 0;
    CHECK(!plumb_kalman_valid(&p, &start));
    p = params();
    p.rate_shift = 17;
    CHECK(!plumb_kalman_valid(&p, &start));
    p = params();
    p.bias_max_turn_q29 = 1 << 25;
    CHECK(!plumb_kalman_valid(&p, &start)); /* more than 1 turn/s at 50 Hz */
    p = params();
    p.qa_hi = (1U << 24) + 1U;
    CHECK(!plumb_kalman_valid(&p, &start));
    p = params();
    plumb_kalman_start_t s = start;
    s.p01_hi = 1; /* positive, and Q cannot carry it */
    CHECK(!plumb_kalman_valid(&p, &s));
    p.qa_hi = 3;
    CHECK(!plumb_kalman_valid(&p, &s));
    p.qa_hi = 4;
    CHECK(plumb_kalman_valid(&p, &s));
    s = start;
    s.p00_hi = (1U << 25) + 1U;
    CHECK(!plumb_kalman_valid(&p, &s));
}

int main(void) {
    by_hand();
    integrates();
    innovation_wraps();
    equations();
    fractions();
    never();
    refuses();
    return check_failures != 0;
}
