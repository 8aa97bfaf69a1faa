#include "turntable_rate.h"

#define SHOCK_MAX           (1 << 25)  /* 1/8 turn/s Q28: its square is the largest variance */
#define SCALE_MAX           (1 << 28)  /* a quarter */
#define LAG_MAX             (1 << 28)  /* 16 steps */
#define BIAS_MAX            0x7FFFFF00 /* of both biases: 45 deg/s; at 250 Hz 45 deg/s^2 */
#define SCALE_PROJECTED_MAX (1 << 29)  /* 2 turn/s per unit */
#define LAG_PROJECTED_MAX   (1 << 25)  /* 1/8 turn/s per step of lag */

PART void plumb_turntable_correct(plumb_turntable_words_t *w, unsigned i, const int32_t gain_q28[FUSION_ROWS],
                                  int32_t innovation_q28) {
    correct_one(&w->rate_fused_turnps_q28[i], gain_q28[FUSION_RATE], innovation_q28, 28, RATE_MAX);
    correct_one(&w->bias_gyro_turnps_q34[i], gain_q28[FUSION_GYRO_BIAS], innovation_q28, 22, BIAS_MAX);
    correct_one(&w->bias_angular_turnps_q42[i], gain_q28[FUSION_ANGULAR_BIAS], innovation_q28, 16, BIAS_MAX);
}

/* Second stage of one axis: estimate scale and lag from the innovation, and add their part to the gains. */
static void learn(plumb_turntable_words_t *w, const plumb_fusion_params_t *f, const turntable_step_t *s,
                  unsigned i, int64_t s_q64, int32_t gain[FUSION_ROWS]) {
    const int32_t rate = s->expected_q28[i];
    const int32_t scale = plumb_fusion_parameter_project(
        &w->scale[i], s->age_q24, add_scaled(0, f->share_q30, rate, 30), SCALE_PROJECTED_MAX);
    const int32_t lag = plumb_fusion_parameter_project(&w->lag[i], s->age_q24, -asr32(s->lagged_q34[i], 6),
                                                       LAG_PROJECTED_MAX);
    plumb_fusion_parameter_update(&w->scale[i], gain, scale);
    plumb_fusion_parameter_update(&w->lag[i], gain, lag);
    if (!s->angular || s->shock) {
        return;
    }
    const int32_t innovation = w->innovation_turnps_q28[i];
    const int64_t scale_q60 = plumb_fusion_parameter_cross(&w->scale[i], scale);
    const int64_t lag_q60 = plumb_fusion_parameter_cross(&w->lag[i], lag);
    const fusion_inverse_t all =
        plumb_fusion_inverse(s_q64 + 16 * mul_shift(scale_q60, scale, 28) + 16 * mul_shift(lag_q60, lag, 28));
    const int32_t scale_gain = plumb_fusion_parameter_learn(&w->scale[i], scale_q60, all, gain);
    const int32_t lag_gain = plumb_fusion_parameter_learn(&w->lag[i], lag_q60, all, gain);
    correct_one(&w->scale_q30[i], scale_gain, innovation, 18, SCALE_MAX);
    correct_one(&w->lag_step_q24[i], lag_gain, innovation, 24, LAG_MAX);
    w->lag_step_q24[i] = max_i32(w->lag_step_q24[i], 0);
}

PART void plumb_turntable_compare_rates(plumb_turntable_words_t *w, const plumb_fusion_params_t *f,
                                        turntable_step_t *s) {
    int64_t *p = w->covariance_q64, u[FUSION_ROWS], largest_q64 = 0;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t rate = s->expected_q28[i];
        const int32_t scale_q30 = add_scaled(0, f->share_q30, w->scale_q30[i], 30);
        const int64_t seen =
            (int64_t)add_scaled(rate, rate, scale_q30, 30) + asr32(w->bias_gyro_turnps_q34[i] + 32, 6);
        const int32_t innovation =
            (w->gyro.spikes >> i & 1U) != 0U ? 0 : sat_i32(w->rate_turnps_q28[i] - seen);
        w->innovation_turnps_q28[i] = clamp_i32(innovation, -INNOVATION_MAX, INNOVATION_MAX);
        const int32_t size = clamp_i32(innovation, -SHOCK_MAX, SHOCK_MAX);
        const int64_t square_q64 = 256 * mul_i64(size, size);
        largest_q64 = square_q64 > largest_q64 ? square_q64 : largest_q64;
    }
    const int64_t r_q64 = (int64_t)f->r_gyro_q44 << 20;
    int64_t s_q64 = plumb_fusion_project_rate(p, s->age_q24, u) + r_q64;
    s->shock =
        asr64(largest_q64, 5) > s_q64; /* 5.7 sigma: a rate that the angular accelerometer did not see */
    if (s->shock) {
        w->flags |= PLUMB_TURNTABLE_FLAG_SHOCK;
        p[FUSION_CELL(FUSION_RATE, FUSION_RATE)] += largest_q64;
        s_q64 = plumb_fusion_project_rate(p, s->age_q24, u) + r_q64;
    }
    int32_t first[FUSION_ROWS];
    plumb_fusion_gains(u, s_q64, first);
    plumb_fusion_update(p, first, u);
    for (unsigned i = 0; i < 3U; i++) {
        int32_t gain[FUSION_ROWS] = {first[0], first[1], first[2], first[3], first[4]};
        if ((w->gyro.spikes >> i & 1U) != 0U) {
            continue;
        }
        if (!s->rest && f->layer != PLUMB_FUSION_ATTITUDE) {
            learn(w, f, s, i, s_q64, gain);
        }
        plumb_turntable_correct(w, i, gain, w->innovation_turnps_q28[i]);
        if (f->layer == PLUMB_FUSION_DATA) {
            s->turn_q60[i] += correction_q60(gain[FUSION_ANGLE], w->innovation_turnps_q28[i]);
        }
    }
}
