#include "core/error_filter.h"
#include "core/fixed.h"
#include <stdbool.h>

#define INNOVATION_LIMIT_Q28 ((1 << 28) - 1)
#define GATE                 25 /* 5^2: beyond 5 sigma a supposed rest is a turn */

/* For the slices that have cycles to spare beside the step: small rather than fast. */
#if defined(__GNUC__) && defined(__arm__) && !defined(__clang__)
#define SMALL __attribute__((optimize("Os")))
#else
#define SMALL
#endif

/* Adds to an entry of the covariance or to a correction, modulo 2^32: no input makes the sum undefined. */
static inline void add(int32_t *to, int32_t by) {
    *to = add_wrap(*to, by);
}

/* 16 x, modulo 2^32: converts a product of Q28 and Q32 from Q28 to Q32. */
static inline int32_t times_16(int32_t x) {
    return wrap_i32((uint32_t)x << 4);
}

/* Row `i` of a lower triangle. */
static inline int32_t *row_of(int32_t *triangle, unsigned i) {
    return triangle + i * (i + 1U) / 2U;
}

/* Address of the variance of a state. */
static inline int32_t *variance_of(plumb_error_filter_t *e, unsigned state) {
    return &row_of(e->covariance_q32, state)[state];
}

/* Sum of the products of six, each Q32 and rounded to nearest. */
static int32_t weighted(const int32_t by[6], const int32_t of[6]) {
    int32_t sum = 0;
    for (unsigned i = 0; i < 6U; i++) {
        add(&sum, mulhi_near(by[i], of[i]));
    }
    return sum;
}

SELDOM_CALLED void plumb_error_filter_start(plumb_error_filter_t *e, int32_t bias, int32_t scale,
                                            int32_t tilt, int32_t velocity) {
    *e = (plumb_error_filter_t){.half_lever_q32 = 0};
    for (unsigned i = 0; i < 3U; i++) {
        *variance_of(e, BIAS + i) = bias;
        *variance_of(e, SCALE + i) = scale;
    }
    for (unsigned i = 0; i < 2U; i++) {
        *variance_of(e, TILT + i) = tilt;
        *variance_of(e, VELOCITY + i) = velocity;
    }
}

SMALL void plumb_error_filter_predict(plumb_error_filter_t *e) {
    int32_t *const by = e->correction_q28;
    const int32_t lever = e->half_lever_q32;
    add(&by[VELOCITY], mulhi_near(lever, by[TILT + 1]));
    add(&by[VELOCITY + 1], -mulhi_near(lever, by[TILT]));
    add(&by[TILT], weighted(e->coupling_q32[0], by));
    add(&by[TILT + 1], weighted(e->coupling_q32[1], by));
    add(&by[VELOCITY], mulhi_near(lever, by[TILT + 1]));
    add(&by[VELOCITY + 1], -mulhi_near(lever, by[TILT]));
}

SELDOM_CALLED void plumb_error_filter_grow_velocity(plumb_error_filter_t *e) {
    int32_t *const covariance = e->covariance_q32;
    const int32_t lever = e->half_lever_q32;
    int32_t *const tilt_x = row_of(covariance, TILT), *const tilt_y = row_of(covariance, TILT + 1);
    int32_t *const x = row_of(covariance, VELOCITY), *const y = row_of(covariance, VELOCITY + 1);
    for (unsigned i = 0; i < TILT; i++) {
        add(&x[i], mulhi_near(lever, tilt_y[i]));
        add(&y[i], -mulhi_near(lever, tilt_x[i]));
    }
    const int32_t x_by_y = x[TILT + 1], y_by_x = y[TILT], y_by_y = y[TILT + 1];
    add(&x[TILT], mulhi_near(lever, tilt_y[TILT]));
    add(&x[TILT + 1], mulhi_near(lever, tilt_y[TILT + 1]));
    add(&y[TILT], -mulhi_near(lever, tilt_x[TILT]));
    add(&y[TILT + 1], -mulhi_near(lever, tilt_y[TILT]));
    add(&x[VELOCITY], mulhi_near(lever, add_wrap(x_by_y, x[TILT + 1])));
    add(&y[VELOCITY], mulhi_near(lever, y_by_y) - mulhi_near(lever, x[TILT]));
    add(&y[VELOCITY + 1], -mulhi_near(lever, add_wrap(y_by_x, y[TILT])));
}

void plumb_error_filter_grow_tilt(plumb_error_filter_t *e, unsigned axis) {
    int32_t *const covariance = e->covariance_q32;
    const int32_t *const coupling = e->coupling_q32[axis];
    int32_t *const own = row_of(covariance, TILT + axis), *const other = row_of(covariance, TILT + 1U - axis);
    int32_t *const x = row_of(covariance, VELOCITY), *const y = row_of(covariance, VELOCITY + 1);
    const int32_t *entry = covariance;
    int32_t grown[6];
    for (unsigned i = 0; i < 6U; i++) {
        int32_t sum = own[i];
        for (unsigned j = 0; j < i; j++, entry++) {
            add(&sum, mulhi_near(coupling[j], *entry));
            add(&grown[j], mulhi_near(coupling[i], *entry));
        }
        grown[i] = add_wrap(sum, mulhi_near(coupling[i], *entry++));
    }
    const int32_t *const of[5] = {other, x, y, own, grown};
    int32_t *const to[5] = {&row_of(covariance, TILT + 1)[TILT], &x[TILT + axis], &y[TILT + axis],
                            &own[TILT + axis], &own[TILT + axis]};
    for (unsigned i = 0; i < 5U; i++) {
        add(to[i], weighted(coupling, of[i]));
    }
    for (unsigned i = 0; i < 6U; i++) {
        own[i] = grown[i];
    }
}

/* Adds to a variance that has not reached its limit; the additions are below the limit. */
static inline void grow(int32_t *variance, int32_t by) {
    if (*variance < VARIANCE_LIMIT_Q32) {
        *variance += by;
    }
}

SMALL void plumb_error_filter_grow(plumb_error_filter_t *e, int32_t bias_growth_q32,
                                   int32_t scale_growth_q32) {
    plumb_error_filter_grow_velocity(e);
    int32_t *variance = e->covariance_q32;
    for (unsigned i = 0; i < STATES; i++) {
        grow(variance, i < SCALE      ? bias_growth_q32
                       : i < TILT     ? scale_growth_q32
                       : i < VELOCITY ? e->tilt_growth_q32
                                      : e->velocity_growth_q32);
        variance += i + 2U;
        e->correction_q28[i] = 0;
    }
}

SMALL void plumb_error_filter_weigh(plumb_error_filter_t *e, unsigned at, uint64_t variance_q32,
                                    int32_t measured_q28) {
    int32_t *const covariance = e->covariance_q32;
    for (unsigned i = 0; i < STATES; i++) {
        e->measured_row_q32[i] = i <= at ? row_of(covariance, at)[i] : row_of(covariance, i)[at];
    }

    const uint64_t exact = (uint32_t)e->measured_row_q32[at] + variance_q32;
    const unsigned coarse = hi_u64(exact) != 0U ? 4U : 0U;
    const uint32_t sum = max_u32((uint32_t)(exact >> coarse), 1U);
    const int32_t innovation =
        clamp_i32(sub_wrap(measured_q28, e->correction_q28[at]), -INNOVATION_LIMIT_Q28, INNOVATION_LIMIT_Q28);
    /* innovation^2 Q32 against the variance of the innovation */
    const bool beyond = at < SCALE && (uint64_t)mul_i64(innovation, innovation) >> 24 > mul_u64(GATE, sum);
    /* gain: upper word of row * inverse, times 2^shift */
    const unsigned n = clz32(sum), one = 2U + coarse, shift = n < one ? 0U : n - one;
    const int32_t inverse = beyond ? 0 : (int32_t)(reciprocal_q61(sum << n >> 1) >> (n < one ? one - n : 0U));
    const int32_t limit = INT32_MAX >> shift;
    for (unsigned i = 0; i < STATES; i++) {
        const int32_t gain_q28 =
            clamp_i32(mulhi_i32(e->measured_row_q32[i], inverse), -limit, limit) * (1 << shift);
        e->gain_q28[i] = gain_q28;
        add(&e->correction_q28[i], times_16(mulhi_near(gain_q28, innovation)));
    }
}

SMALL void plumb_error_filter_shrink(plumb_error_filter_t *e) {
    int32_t *entry = e->covariance_q32;
    for (unsigned i = 0; i < STATES; i++) {
        const int32_t gain_q28 = e->gain_q28[i];
        for (unsigned j = 0; j <= i; j++, entry++) {
            *entry = sub_wrap(*entry, times_16(mulhi_near(gain_q28, e->measured_row_q32[j])));
        }
    }
}
