#include "plumb/turntable.h"
#include "turntable_attitude.h"
#include "turntable_rate.h"

#define INCREMENT_MAX ((1 << 30) - 1) /* Q34: 1/16 turn/s per step */
#define STEP_Q24      (1UL << 24)
#define ANGULAR_STALE 4U /* steps; the gyro's history lasts four of its periods */

SELDOM_CALLED void plumb_turntable_init(plumb_turntable_t *c, const plumb_params_t *p) {
    const plumb_fusion_params_t *f = &p->fusion;
    plumb_turntable_words_t *w = &c->words;
    *c = (plumb_turntable_t){0};
    plumb_prefilter_init(&w->gyro);
    plumb_prefilter_init(&w->angular);
    w->attitude.w = w->attitude_angular.w = PLUMB_QUATERNION_ONE;
    w->gyro_age_step_q24 = f->gyro_age_step_q24;
    w->covariance_q64[FUSION_CELL(FUSION_GYRO_BIAS, FUSION_GYRO_BIAS)] = (int64_t)f->p_gyro_bias_q40 << 24;
    w->covariance_q64[FUSION_CELL(FUSION_ANGULAR_BIAS, FUSION_ANGULAR_BIAS)] = (int64_t)f->p_angular_bias_q52
                                                                               << 12;
    for (unsigned i = 0; i < 3U; i++) {
        w->lag_step_q24[i] = f->lag_step_q24;
        w->scale[i].variance_q60 = (int64_t)f->v_scale_q40 << 20;
        w->lag[i].variance_q60 = (int64_t)f->v_lag_q30 << 30;
    }
}

SELDOM_CALLED bool plumb_turntable_params_valid(const plumb_params_t *p) {
    return plumb_calibration_valid(&p->gyro) && plumb_calibration_valid(&p->angular) &&
           plumb_prefilter_valid(&p->gyro_filter) && plumb_prefilter_valid(&p->angular_filter) &&
           plumb_fusion_valid(&p->fusion);
}

/* Convert counts to rate and angular acceleration, and determine when the gyro's sample was taken. */
static void prefilter_sensors(plumb_turntable_words_t *w, const plumb_params_t *p, turntable_step_t *s) {
    const uint32_t stale = p->fusion.gyro_period_step_q24 >> 22;
    const bool away = w->gyro.gap_steps > stale; /* so its next sample starts it anew */
    const uint32_t gyro =
        plumb_prefilter_step(&w->gyro, &p->gyro_filter, &p->gyro, w->raw, stale, w->rate_turnps_q28);
    const uint32_t angular = plumb_prefilter_step(&w->angular, &p->angular_filter, &p->angular, w->raw + 3,
                                                  ANGULAR_STALE, w->acceleration_turnps2_q28);
    const uint32_t period = p->fusion.gyro_period_step_q24;
    uint32_t age = w->gyro_age_step_q24 + STEP_Q24;
    if (age >= period) {
        age -= period;
    }
    /* the sample came in the first step after its instant: clocks may drift and start at any phase */
    if ((gyro & PLUMB_PREFILTER_SAMPLE) != 0U && age >= STEP_Q24) {
        age = age < period / 2U ? STEP_Q24 - 1U : 0U;
    }
    w->gyro_age_step_q24 = age;
    s->gyro = (gyro & PLUMB_PREFILTER_SAMPLE) != 0U;
    s->angular = (angular & PLUMB_PREFILTER_SAMPLE) != 0U;
    s->gyro_lost = w->gyro.gap_steps > stale;
    s->two_attitudes = p->fusion.layer == PLUMB_FUSION_ATTITUDE && !s->rest && !s->gyro_lost && !away;
    s->age_q24 = age < STEP_Q24 ? (int32_t)age : 0;
    /* the flags of the two sensors stand side by side */
    w->flags = gyro | angular << 1 | (s->rest ? PLUMB_TURNTABLE_FLAG_REST : 0U) |
               (s->gyro_lost ? PLUMB_TURNTABLE_FLAG_GYRO_LOST : 0U);
    w->clamped_steps += (w->flags & PLUMB_TURNTABLE_FLAGS_SATURATED) != 0U;
}

/* Increment of the rate of one axis in this step, turn/s Q34: the mean of this sample and the previous one
 * (twice_q28 is their sum), minus the bias, corrected by its share of the scale difference. Without a sample:
 * the slope of the gyro. */
static int32_t increment(const plumb_turntable_words_t *w, const plumb_params_t *p, const turntable_step_t *s,
                         unsigned i, int64_t twice_q28) {
    const plumb_fusion_params_t *f = &p->fusion;
    int64_t sum = 0;
    if (s->angular) {
        const int32_t excess_q30 = add_scaled(0, (1 << 30) - f->share_q30, w->scale_q30[i], 30);
        sum = asr64(twice_q28 * f->dt_s_q32 + (1 << 26), 27) - asr32(w->bias_angular_turnps_q42[i] + 128, 8);
        sum += mul_shift(sum, excess_q30, 30);
    } else if (!s->gyro_lost) {
        const int64_t rise_q28 = mul_i64(w->gyro.last[i] - w->gyro.before[i], p->gyro.gain);
        sum = asr64(rise_q28 * f->gyro_samples_step_q30, 24);
    }
    return (int32_t)within_i64(sum, INCREMENT_MAX);
}

/* Propagate the rate of every axis by one step, and predict the gyro's reading at its sampling instant, by
 * linear interpolation between steps. */
static void propagate_rate(plumb_turntable_words_t *w, const plumb_params_t *p, turntable_step_t *s,
                           const int32_t before_q28[3], bool adjacent) {
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t now_q28 = w->acceleration_turnps2_q28[i];
        const int32_t grown = increment(w, p, s, i, (int64_t)now_q28 + (adjacent ? before_q28[i] : now_q28));
        const int32_t lagged = w->increment_lagged_turnps_q34[i];
        const int32_t follows = add_scaled(0, grown - lagged, p->fusion.lag_alpha_q31, 31);
        s->lagged_q34[i] = add_scaled(lagged + follows, -follows, s->age_q24, 24);
        s->turn_angular_q60[i] =
            mul_i64(w->rate_fused_turnps_q28[i] + asr32(grown + 64, 7), p->fusion.dt_s_q32);
        w->increment_turnps_q34[i] = grown;
        w->increment_lagged_turnps_q34[i] = lagged + follows;
        w->rate_fused_turnps_q28[i] =
            clamp_i32(w->rate_fused_turnps_q28[i] + asr32(grown + 32, 6), -RATE_MAX, RATE_MAX);
        s->expected_q28[i] = add_scaled(add_scaled(w->rate_fused_turnps_q28[i], -grown, s->age_q24, 30),
                                        -s->lagged_q34[i], w->lag_step_q24[i], 30);
        s->turn_q60[i] = s->turn_angular_q60[i];
    }
}

static void predict(plumb_turntable_words_t *w, const plumb_params_t *p, const turntable_step_t *s) {
    const plumb_fusion_params_t *f = &p->fusion;
    const fusion_predict_t step = {
        .angular = s->angular,
        .difference = s->two_attitudes,
        .gyro_angle = s->two_attitudes,
        .rate_q64 = s->angular ? (uint64_t)f->q_rate_q52 << 12 : (uint64_t)f->q_rate_lost_q44 << 20,
        .gyro_bias_q64 = (uint64_t)f->q_gyro_bias_q60 << 4,
        .angular_bias_q64 = f->q_angular_bias_q64,
    };
    plumb_fusion_predict(w->covariance_q64, &step, f->dt_s_q32);
    if (s->rest || f->layer == PLUMB_FUSION_ATTITUDE) {
        return;
    }
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t drive = add_scaled(0, (1 << 30) - f->share_q30, w->increment_turnps_q34[i], 36);
        plumb_fusion_parameter_predict(&w->scale[i], s->angular, s->angular ? drive : 0, f->dt_s_q32);
        plumb_fusion_parameter_predict(&w->lag[i], s->angular, 0, f->dt_s_q32);
    }
}

/* At rest: measurement update with rate 0, so that the sensors' readings go into the biases. */
static void update_zero_rate(plumb_turntable_words_t *w) {
    int64_t *p = w->covariance_q64, u[FUSION_ROWS];
    int32_t gain[FUSION_ROWS];
    plumb_fusion_gains(u, plumb_fusion_project_state(p, FUSION_RATE, u) + STILL_Q64, gain);
    plumb_fusion_update(p, gain, u);
    for (unsigned i = 0; i < 3U; i++) {
        plumb_turntable_correct(w, i, gain, -w->rate_fused_turnps_q28[i]);
    }
    plumb_turntable_merge_attitudes(w);
    for (unsigned j = 0; j < FUSION_STATES; j++) {
        p[FUSION_CELL(FUSION_ANGLE, j)] = 0;
    }
}

void plumb_turntable_step(plumb_turntable_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                          int32_t setpoint) {
    plumb_turntable_words_t *w = &c->words;
    const int32_t before_q28[3] = {w->acceleration_turnps2_q28[0], w->acceleration_turnps2_q28[1],
                                   w->acceleration_turnps2_q28[2]};
    const bool adjacent = w->angular.gap_steps == 0U;
    w->step++;
    for (unsigned i = 0; i < sizeof w->raw / sizeof w->raw[0]; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint = setpoint;
    turntable_step_t s = {.rest = w->step <= p->fusion.rest_steps};
    prefilter_sensors(w, p, &s);
    propagate_rate(w, p, &s, before_q28, adjacent);
    predict(w, p, &s);
    if (s.rest) {
        update_zero_rate(w);
    }
    if (s.gyro && (s.rest || p->fusion.layer != PLUMB_FUSION_ATTITUDE)) {
        plumb_turntable_compare_rates(w, &p->fusion, &s);
    }
    plumb_turntable_propagate_attitude(w, &p->fusion, &s);
}
