#include "fusion.h"

#define CELL_MAX  ((int64_t)1 << 58) /* largest variance: (45 deg/s)^2 */
#define ANGLE_MAX ((int64_t)1 << 61) /* largest cell in the row of the angle */
#define GAIN_MAX  (1 << 30)          /* 4 */

static bool in_range(int32_t x, int32_t low, int32_t high) {
    return x >= low && x <= high;
}

SELDOM_CALLED bool plumb_fusion_valid(const plumb_fusion_params_t *f) {
    return f->layer <= PLUMB_FUSION_PRINTED && in_range(f->dt_s_q32, 1, 1 << 26) && f->step_hz_q16 >= 1 &&
           f->gyro_period_step_q24 >= 1UL << 24 && f->gyro_period_step_q24 <= 1UL << 28 &&
           f->gyro_age_step_q24 < f->gyro_period_step_q24 &&
           in_range(f->gyro_samples_step_q30, 1 << 26, 1 << 30) && in_range(f->lag_step_q24, 0, 1 << 28) &&
           f->lag_alpha_q31 >= 0 && in_range(f->share_q30, 0, 1 << 30) && f->r_gyro_q44 >= 1UL << 12 &&
           f->v_lag_q30 <= 1UL << 30;
}

/* Row i, column j of the symmetric matrix, in any order. */
static int64_t *cell(int64_t p[FUSION_CELLS], unsigned i, unsigned j) {
    return &p[i >= j ? FUSION_CELL(i, j) : FUSION_CELL(j, i)];
}

/* Makes state i independent of all others and sets its variance. */
static void isolate(int64_t p[FUSION_CELLS], unsigned i, int64_t variance) {
    for (unsigned j = 0; j < FUSION_ROWS; j++) {
        *cell(p, i, j) = 0;
    }
    *cell(p, i, i) = variance;
}

/* False if a cell may be outside its limit, judged by its upper word: 0 to 2^26 for a variance, +-2^29 in the
 * row of the angle, +-2^26 elsewhere. */
static bool surely_bounded(const int64_t p[FUSION_CELLS]) {
#define UPPER(i, j) hi_u64((uint64_t)p[FUSION_CELL(i, j)])
#define MOVED(i, j) (UPPER(i, j) + (1UL << 26))
#define ANGLE(j)    (UPPER(FUSION_ANGLE, j) + (1UL << 29))
    const uint32_t variances = UPPER(0, 0) | UPPER(1, 1) | UPPER(2, 2) | UPPER(3, 3);
    const uint32_t others = MOVED(1, 0) | MOVED(2, 0) | MOVED(2, 1) | MOVED(3, 0) | MOVED(3, 1) | MOVED(3, 2);
    const uint32_t angles = ANGLE(0) | ANGLE(1) | ANGLE(2) | ANGLE(3);
    return (variances >> 26 | others >> 27 | angles >> 30) == 0U;
}

/* Brings every cell within its limit, because the sums of the next step rely on it for all parameters. */
static void bound(int64_t p[FUSION_CELLS]) {
    if (surely_bounded(p)) {
        return;
    }
    for (unsigned i = 0; i < FUSION_STATES; i++) {
        const int64_t variance = *cell(p, i, i);
        if (variance > CELL_MAX || variance < 0) {
            isolate(p, i, variance < 0 ? 0 : CELL_MAX);
        }
        for (unsigned j = i + 1U; j < FUSION_ROWS; j++) {
            const int64_t limit = j == FUSION_ANGLE ? ANGLE_MAX : CELL_MAX, both = *cell(p, j, i);
            if (within_i64(both, limit) != both) {
                *cell(p, j, i) = 0;
            }
        }
    }
}

/* Adds error k / 2^shift to error i (negate: subtracts it): P = F P F^T, where F is the identity plus that
 * one element. */
static void couple(int64_t p[FUSION_CELLS], unsigned i, unsigned k, unsigned shift, bool negate) {
    for (unsigned twice = 0; twice < 2U; twice++) { /* from the left and from the right: both change (i, i) */
        const int64_t part = asr64(*cell(p, k, i), shift);
        *cell(p, i, i) += negate ? -part : part;
        if (twice == 0U) {
            for (unsigned j = 0; j < FUSION_ROWS; j++) {
                const int64_t other = asr64(*cell(p, k, j), shift);
                if (j != i) {
                    *cell(p, i, j) += negate ? -other : other;
                }
            }
        }
    }
}

void plumb_fusion_predict(int64_t p[FUSION_CELLS], const fusion_predict_t *step, int32_t dt_s_q32) {
    /* The row of the angle first, while the other rows still have their old values. */
    const unsigned source = step->gyro_angle ? FUSION_GYRO_BIAS : FUSION_RATE;
    for (unsigned j = 0; j < FUSION_STATES; j++) {
        const int64_t part = mul_shift(*cell(p, source, j), dt_s_q32, 32);
        p[FUSION_CELL(FUSION_ANGLE, j)] += step->gyro_angle ? -part : part;
    }
    if (step->difference) {
        couple(p, FUSION_DIFFERENCE, FUSION_RATE, 0, false);
        couple(p, FUSION_DIFFERENCE, FUSION_GYRO_BIAS, 0, false);
    }
    if (step->angular) {
        couple(p, FUSION_RATE, FUSION_ANGULAR_BIAS, 2, true);
    }
    *cell(p, FUSION_RATE, FUSION_RATE) += (int64_t)step->rate_q64;
    *cell(p, FUSION_GYRO_BIAS, FUSION_GYRO_BIAS) += (int64_t)step->gyro_bias_q64;
    *cell(p, FUSION_ANGULAR_BIAS, FUSION_ANGULAR_BIAS) += (int64_t)step->angular_bias_q64;
    bound(p);
}

int64_t plumb_fusion_project_rate(int64_t p[FUSION_CELLS], int32_t age_q24, int64_t u_q64[FUSION_ROWS]) {
    for (unsigned i = 0; i < FUSION_ROWS; i++) {
        u_q64[i] = *cell(p, i, FUSION_RATE) + *cell(p, i, FUSION_GYRO_BIAS) +
                   mul_shift(*cell(p, i, FUSION_ANGULAR_BIAS), age_q24, 26);
    }
    const int64_t all =
        u_q64[FUSION_RATE] + u_q64[FUSION_GYRO_BIAS] + mul_shift(u_q64[FUSION_ANGULAR_BIAS], age_q24, 26);
    return all < 0 ? 0 : all;
}

int64_t plumb_fusion_project_state(int64_t p[FUSION_CELLS], unsigned state, int64_t u_q64[FUSION_ROWS]) {
    for (unsigned i = 0; i < FUSION_ROWS; i++) {
        u_q64[i] = *cell(p, i, state);
    }
    return u_q64[state];
}

fusion_inverse_t plumb_fusion_inverse(int64_t s_q64) {
    const unsigned n = clz32(hi_u64((uint64_t)s_q64)) - 1U;
    return (fusion_inverse_t){reciprocal_q61(hi_u64((uint64_t)s_q64 << n)), 32U - n};
}

/* u / s by the reciprocal y of s; shift brings u to the format of the gain. */
static int32_t ratio(int64_t u, uint32_t y_q61, unsigned shift) {
    return wrap_i32((uint32_t)asr64(mul_i64(sat_i32(asr64(u, shift)), wrap_i32(y_q61)), 31));
}

void plumb_fusion_gains(const int64_t u_q64[FUSION_ROWS], int64_t s_q64, int32_t gain_q28[FUSION_ROWS]) {
    const fusion_inverse_t y = plumb_fusion_inverse(s_q64);
    for (unsigned i = 0; i < FUSION_ROWS; i++) {
        gain_q28[i] = clamp_i32(ratio(u_q64[i], y.y_q61, y.exponent + 2U), -GAIN_MAX, GAIN_MAX);
    }
}

void plumb_fusion_update(int64_t p[FUSION_CELLS], const int32_t gain_q28[FUSION_ROWS],
                         const int64_t u_q64[FUSION_ROWS]) {
    for (unsigned i = 0; i < FUSION_ROWS; i++) {
        for (unsigned j = 0; j <= i && j < FUSION_STATES; j++) {
            if (u_q64[j] != 0 &&
                gain_q28[i] != 0) { /* a layer without a difference has a row and a column of zeros */
                p[FUSION_CELL(i, j)] -= mul_shift(u_q64[j], gain_q28[i], 28);
            }
        }
    }
    bound(p);
}

void plumb_fusion_parameter_predict(plumb_fusion_parameter_t *a, bool angular, int32_t drive_q28,
                                    int32_t dt_s_q32) {
    int32_t *v = a->sensitivity_q28;
    v[3] = add_scaled(v[3], v[FUSION_RATE], dt_s_q32, 32);
    const int32_t lost = angular ? asr32(v[FUSION_ANGULAR_BIAS], 2) : 0;
    v[FUSION_RATE] = sat_i32((int64_t)v[FUSION_RATE] + drive_q28 - lost);
}

int32_t plumb_fusion_parameter_project(const plumb_fusion_parameter_t *a, int32_t age_q24, int32_t direct_q28,
                                       int32_t limit_q28) {
    const int32_t *v = a->sensitivity_q28;
    const int64_t sum = (int64_t)v[FUSION_RATE] + v[FUSION_GYRO_BIAS] + direct_q28;
    return clamp_i32(add_scaled(sat_i32(sum), v[FUSION_ANGULAR_BIAS], age_q24, 26), -limit_q28, limit_q28);
}

void plumb_fusion_parameter_update(plumb_fusion_parameter_t *a, const int32_t gain_q28[FUSION_ROWS],
                                   int32_t projected_q28) {
    int32_t *v = a->sensitivity_q28;
    v[0] = add_scaled(v[0], gain_q28[FUSION_RATE], -projected_q28, 28);
    v[1] = add_scaled(v[1], gain_q28[FUSION_GYRO_BIAS], -projected_q28, 28);
    v[2] = add_scaled(v[2], gain_q28[FUSION_ANGULAR_BIAS], -projected_q28, 28);
    v[3] = add_scaled(v[3], gain_q28[FUSION_ANGLE], -projected_q28, 28);
}

int64_t plumb_fusion_parameter_cross(const plumb_fusion_parameter_t *a, int32_t projected_q28) {
    return mul_shift(a->variance_q60, projected_q28, 28);
}

int32_t plumb_fusion_parameter_learn(plumb_fusion_parameter_t *a, int64_t u_q60, fusion_inverse_t y,
                                     int32_t gain_q28[FUSION_ROWS]) {
    const int32_t learnt_q20 = ratio(u_q60, y.y_q61, y.exponent + 6U);
    const int64_t left = a->variance_q60 - mul_shift(u_q60, learnt_q20, 20);
    a->variance_q60 = left < 0 ? 0 : left;
    const int32_t *v = a->sensitivity_q28;
    gain_q28[FUSION_RATE] = add_scaled(gain_q28[FUSION_RATE], v[0], learnt_q20, 20);
    gain_q28[FUSION_GYRO_BIAS] = add_scaled(gain_q28[FUSION_GYRO_BIAS], v[1], learnt_q20, 20);
    gain_q28[FUSION_ANGULAR_BIAS] = add_scaled(gain_q28[FUSION_ANGULAR_BIAS], v[2], learnt_q20, 20);
    gain_q28[FUSION_ANGLE] = add_scaled(gain_q28[FUSION_ANGLE], v[3], learnt_q20, 20);
    return learnt_q20;
}
