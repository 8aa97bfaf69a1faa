#include "turntable_attitude.h"

PART void plumb_turntable_merge_attitudes(plumb_turntable_words_t *w) {
    w->attitude_angular = w->attitude;
    for (unsigned j = 0; j < FUSION_STATES; j++) {
        w->covariance_q64[FUSION_CELL(FUSION_DIFFERENCE, j)] = 0;
    }
    w->covariance_q64[FUSION_CELL(FUSION_ANGLE, FUSION_DIFFERENCE)] = 0;
}

/* Rate of the step from the gyro's sample, which is slightly older than the step. */
static int32_t sampled(const plumb_turntable_words_t *w, const turntable_step_t *s, unsigned i) {
    const int64_t ahead_q28 = (int64_t)w->rate_fused_turnps_q28[i] - s->expected_q28[i];
    const int64_t sample_q28 = ahead_q28 + w->rate_turnps_q28[i] - asr32(w->bias_gyro_turnps_q34[i] + 32, 6);
    return (int32_t)within_i64(sample_q28, RATE_MAX);
}

/* Attitude layer: the gyro's own rate, propagated to the steps by the angular acceleration. A gyro sample
 * corrects half of the difference, as the trapezoidal rule does. */
static void align_gyro(plumb_turntable_words_t *w, const plumb_fusion_params_t *f, turntable_step_t *s) {
    const int32_t period_s_q32 = add_scaled(0, f->dt_s_q32, (int32_t)f->gyro_period_step_q24, 24);
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t grown = w->increment_turnps_q34[i], rate = w->rate_corrected_turnps_q28[i];
        int32_t aligned = clamp_i32(rate + asr32(grown + 32, 6), -RATE_MAX, RATE_MAX);
        s->turn_q60[i] = mul_i64(rate + asr32(grown + 64, 7), f->dt_s_q32);
        if (s->gyro && (w->gyro.spikes >> i & 1U) == 0U) {
            const int64_t beside = (int64_t)sampled(w, s, i) - aligned;
            const int32_t surprise = (int32_t)within_i64(beside, INNOVATION_MAX);
            s->turn_q60[i] += asr64(mul_i64(surprise, period_s_q32), 1);
            aligned = clamp_i32(aligned + surprise, -RATE_MAX, RATE_MAX);
        }
        w->rate_corrected_turnps_q28[i] = aligned;
    }
}

/* Attitude layer: correct both attitudes by their difference. */
static void compare_attitudes(plumb_turntable_words_t *w, const plumb_fusion_params_t *f) {
    int64_t *p = w->covariance_q64, u[FUSION_ROWS], turn_q60[3], turn_angular_q60[3];
    int32_t gain[FUSION_ROWS], difference_turn_q32[3];
    /* what the gyro's noise has added since its last sample: (noise of a sample * samples' distance)^2 */
    const int32_t period_q24 = (int32_t)f->gyro_period_step_q24;
    const int64_t walk_q64 =
        mul_shift(mul_shift((int64_t)f->r_gyro_q44 << 20, period_q24, 24), period_q24, 24);
    p[FUSION_CELL(FUSION_DIFFERENCE, FUSION_DIFFERENCE)] += walk_q64;
    p[FUSION_CELL(FUSION_ANGLE, FUSION_DIFFERENCE)] -= mul_shift(walk_q64, f->dt_s_q32, 32);
    plumb_fusion_gains(u, plumb_fusion_project_state(p, FUSION_DIFFERENCE, u) + STILL_Q64, gain);
    plumb_fusion_update(p, gain, u);
    plumb_quaternion_difference(&w->attitude_angular, &w->attitude, difference_turn_q32);
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t difference = add_scaled(0, difference_turn_q32[i], f->step_hz_q16, 20);
        const int32_t innovation = clamp_i32(difference, -INNOVATION_MAX, INNOVATION_MAX);
        w->innovation_turnps_q28[i] = innovation;
        plumb_turntable_correct(w, i, gain, innovation);
        correct_one(&w->rate_corrected_turnps_q28[i], gain[FUSION_GYRO_BIAS], -innovation, 28, RATE_MAX);
        turn_q60[i] = correction_q60(gain[FUSION_ANGLE], innovation);
        turn_angular_q60[i] =
            turn_q60[i] + mul_i64(add_scaled(0, gain[FUSION_DIFFERENCE], innovation, 28), f->dt_s_q32);
    }
    plumb_quaternion_rotate(&w->attitude, turn_q60);
    plumb_quaternion_rotate(&w->attitude_angular, turn_angular_q60);
}

PART void plumb_turntable_propagate_attitude(plumb_turntable_words_t *w, const plumb_fusion_params_t *f,
                                             turntable_step_t *s) {
    if (s->two_attitudes) {
        align_gyro(w, f, s);
        plumb_quaternion_rotate(&w->attitude_angular, s->turn_angular_q60);
        plumb_quaternion_rotate(&w->attitude, s->turn_q60);
        if (s->gyro) {
            compare_attitudes(w, f);
        }
        return;
    }
    /* a gyro that has just returned starts anew, with its own sample and the attitude of the other sensor */
    const bool back = f->layer == PLUMB_FUSION_ATTITUDE && !s->rest && s->gyro;
    for (unsigned i = 0; i < 3U; i++) {
        w->rate_corrected_turnps_q28[i] = back ? sampled(w, s, i) : w->rate_fused_turnps_q28[i];
    }
    if (!s->rest) {
        plumb_quaternion_rotate(&w->attitude, s->turn_q60);
    }
    if (f->layer == PLUMB_FUSION_ATTITUDE) {
        plumb_turntable_merge_attitudes(w);
    }
}
