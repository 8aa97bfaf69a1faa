#include "plumb/plausibility.h"
#include "fixed.h"

#define MS_Q33(ms) ((uint32_t)((uint64_t)(ms) * ((uint64_t)1 << 33) / 1000U))

#define ACCEL_FOR       MS_Q33(200)
#define INNOVATION_FOR  MS_Q33(300)
#define RATE_FOR        MS_Q33(120) /* 28 deg at once are above 15 deg for 156 ms, 0.25 s ln(28 / 15) */
#define CONVERGED_FOR   MS_Q33(300)
#define READY_FOR       MS_Q33(300)
#define INNOVATION_MAX  178956971U /* 15 deg, turn Q32 */
#define MISMATCH_MAX    178956971U /* 60 deg/s over the 0.25 s of the leak: 15 deg */
#define CONVERGED_MAX   35791394U  /* 3 deg, turn Q32 */
#define MISMATCH_LIMIT  (1L << 30) /* a quarter of a turn; the sum is clamped here */
#define UPRIGHT_MAX     715827882U /* 60 deg, turn Q32: one that lies is beyond it */
#define MEAN_OF_AT_MOST (1L << 29) /* inputs of a mean are clamped to +-2^29: their difference fits int32 */

SELDOM_CALLED void plumb_plausibility_init(plumb_plausibility_t *p) {
    *p = (plumb_plausibility_t){.accel_mean_g2_q20 = 1L << 20, .missing = PLUMB_PLAUSIBILITY_MISSING_ALL};
}

/* Counts the time up while the condition is met and down while it is not; true at or above the limit. */
static bool lasts(uint32_t *for_s_q33, bool met, uint32_t dt_s_q33, uint32_t limit_s_q33) {
    if (!met) {
        *for_s_q33 -= min_u32(*for_s_q33, dt_s_q33);
        return *for_s_q33 >= limit_s_q33;
    }
    *for_s_q33 = min_u32(*for_s_q33 + dt_s_q33, limit_s_q33 + dt_s_q33);
    return *for_s_q33 >= limit_s_q33;
}

/* A filter with a high gain follows a wrong accelerometer before the time limit: above a gain of 2 per
 * second, an innovation of 28 deg falls below 15 deg within 0.3 s. The time then counts fourfold. */
static uint32_t early(int32_t k0_q29, uint32_t dt_s_q33) {
    return (uint32_t)k0_q29 > dt_s_q33 >> 3 ? 4U * dt_s_q33 : dt_s_q33;
}

/* True when the condition has been met without a break for limit_s_q33. */
static bool holds(uint32_t *for_s_q33, bool met, uint32_t dt_s_q33, uint32_t limit_s_q33) {
    *for_s_q33 = met ? min_u32(*for_s_q33 + dt_s_q33, limit_s_q33) : 0U;
    return *for_s_q33 >= limit_s_q33;
}

/* One-pole low-pass of 0.25 s: share_q32 is dt / 0.25 s. The value is clamped to +-2^29. */
static void mean(int32_t *of, int32_t value, int32_t share_q32) {
    *of += mulhi_i32(clamp_i32(value, -MEAN_OF_AT_MOST, MEAN_OF_AT_MOST) - *of, share_q32);
}

static bool above_six_sigma(uint32_t innovation_turn_q32, int32_t k0_q29, uint32_t variance,
                            uint32_t unit_turn2_q56) {
    /* innovation^2 > 36 S with S = R / (1 - k0), both sides times 1 - k0, in turn^2 Q56 */
    const uint32_t at_most = min_u32(innovation_turn_q32, 0x7FFFFFFFU);
    const uint32_t square_q34 = (uint32_t)(mul_u64(at_most, at_most) >> 30);
    const uint32_t rest_q29 = (1U << 29) - min_u32((uint32_t)k0_q29, 1U << 29);
    return mul_u64(square_q34, rest_q29) >> 7 > mul_u64(36U * variance, unit_turn2_q56);
}

/* Compares the turn of the accelerometer's tilt with the turn by the gyro. The difference is added to the
 * mismatch, which leaks with 0.25 s, so that noise does not add up. The mean of its absolute value is the
 * unevenness. */
static void compare_rates(plumb_plausibility_t *p, int32_t measured, int32_t rate, int32_t dt_s_q33,
                          int32_t share) {
    const int32_t between = asr32(p->rate_turnps_q28, 1) + asr32(rate, 1);
    const int64_t turned = sub_wrap(measured, p->measured_turn_q32) - asr64(mul_i64(between, dt_s_q33), 29);
    const int64_t sum = p->mismatch_turn_q32 + turned;
    const int64_t within = sum > MISMATCH_LIMIT    ? MISMATCH_LIMIT
                           : sum < -MISMATCH_LIMIT ? -MISMATCH_LIMIT
                                                   : sum;
    const int32_t mismatch = wrap_i32(lo_u64((uint64_t)within));
    p->mismatch_turn_q32 = mismatch - mulhi_i32(mismatch, share);
    mean(&p->unevenness_turn_q32,
         wrap_i32(min_u32(abs_u32(wrap_i32(lo_u64((uint64_t)turned))), MEAN_OF_AT_MOST)), share);
}

/* An accelerometer whose second axis points down, while the estimate is within 60 deg of upright. */
static bool overturned(const plumb_plausibility_bounds_t *b, const int32_t *word) {
    return b->doubts && word[b->accel[1]] < 0 && abs_u32(word[b->tilt]) < UPRIGHT_MAX;
}

static uint16_t missing(plumb_plausibility_t *p, const plumb_plausibility_bounds_t *b, const int32_t *word,
                        uint32_t dt) {
    const uint32_t force = abs_u32(p->accel_mean_g2_q20);
    const bool still = abs_u32(p->rate_mean_turnps_q28) <= b->rest_turnps_q28 &&
                       force >= b->rest_min_g2_q20 && force <= b->rest_max_g2_q20;
    unsigned bits = 0;

    bits |= still ? 0U : PLUMB_PLAUSIBILITY_MOVING;
    bits |= p->converged && p->converged_s_q33 >= CONVERGED_FOR ? 0U : PLUMB_PLAUSIBILITY_CONVERGING;
    bits |= abs_u32(word[b->setpoint]) <= b->setpoint_max ? 0U : PLUMB_PLAUSIBILITY_SETPOINT;
    bits |= abs_u32(word[b->tilt]) <= b->ready_turn_q32 ? 0U : PLUMB_PLAUSIBILITY_TILTED;
    bits |= holds(&p->ready_s_q33, bits == 0U, dt, READY_FOR) ? 0U : PLUMB_PLAUSIBILITY_SETTLING;
    return (uint16_t)bits;
}

void plumb_plausibility_step(plumb_plausibility_t *p, const plumb_plausibility_bounds_t *bounds,
                             const void *record, int32_t dt_s_q33, uint32_t variance_turn2_q56) {
    const int32_t *const word = record;
    const plumb_plausibility_bounds_t *const b = bounds;
    const uint32_t dt = (uint32_t)dt_s_q33;
    const int32_t share = 2 * dt_s_q33; /* dt / 0.25 s, Q32 */
    const int32_t measured = word[b->tilt_measured], rate = word[b->rate];
    const uint32_t innovation = abs_u32(word[b->innovation]);
    const uint32_t force = (uint32_t)((mul_u64(abs_u32(word[b->accel[0]]), abs_u32(word[b->accel[0]])) +
                                       mul_u64(abs_u32(word[b->accel[1]]), abs_u32(word[b->accel[1]]))) >>
                                      32);
    if (!p->begun) {
        p->begun = true;
        p->measured_turn_q32 = measured;
        p->rate_turnps_q28 = rate;
    }
    compare_rates(p, measured, rate, dt_s_q33, share);
    p->measured_turn_q32 = measured;
    p->rate_turnps_q28 = rate;
    mean(&p->innovation_turn_q32, word[b->innovation], share);
    mean(&p->rate_mean_turnps_q28, wrap_i32(min_u32(abs_u32(word[b->rate_corrected]), MEAN_OF_AT_MOST)),
         share);
    mean(&p->accel_mean_g2_q20, wrap_i32(min_u32(force, MEAN_OF_AT_MOST)), share);

    const bool centred = abs_u32(p->innovation_turn_q32) <= CONVERGED_MAX;
    const bool converged = holds(&p->converged_s_q33, centred, dt, CONVERGED_FOR);
    p->converged = p->converged || converged;

    const bool odd_force = force < b->accel_min_g2_q20 || force > b->accel_max_g2_q20;
    const bool odd_innovation =
        p->converged && innovation > INNOVATION_MAX &&
        above_six_sigma(innovation, word[b->k0], (uint32_t)word[b->variance], variance_turn2_q56);
    const bool odd_rate = abs_u32(p->mismatch_turn_q32) > MISMATCH_MAX ||
                          abs_u32(p->unevenness_turn_q32) > b->uneven_turn_q32 || overturned(b, word);
    unsigned failed = 0;
    failed |= lasts(&p->accel_s_q33, odd_force, dt, ACCEL_FOR) ? PLUMB_PLAUSIBILITY_ACCEL : 0U;
    failed |= lasts(&p->innovation_s_q33, odd_innovation, early(word[b->k0], dt), INNOVATION_FOR)
                  ? PLUMB_PLAUSIBILITY_INNOVATION
                  : 0U;
    failed |= lasts(&p->rate_s_q33, odd_rate, dt, RATE_FOR) ? PLUMB_PLAUSIBILITY_RATE : 0U;
    p->failed = (uint16_t)failed;
    p->missing = missing(p, b, word, dt);
}
