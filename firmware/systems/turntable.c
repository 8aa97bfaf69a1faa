#include "plumb/turntable.h"
#include "core/fusion.h"

#define RATE_MAX            1879048192      /* 7 turn/s Q28 */
#define INCREMENT_MAX       ((1 << 30) - 1) /* Q34: 1/16 turn/s per step */
#define INNOVATION_MAX      (1 << 30)       /* 4 turn/s Q28 */
#define SHOCK_MAX           (1 << 25)       /* 1/8 turn/s Q28: its square is the largest variance */
#define STILL_Q64           ((int64_t)1 << 32) /* of zero rate at rest, and of zero difference: (0.006 deg/s)^2 */
#define SCALE_MAX           (1 << 28)          /* a quarter */
#define LAG_MAX             (1 << 28)          /* 16 steps */
#define BIAS_MAX            0x7FFFFF00         /* of both biases: 45 deg/s; at 250 Hz 45 deg/s^2 */
#define STEP_Q24            (1UL << 24)
#define SCALE_PROJECTED_MAX (1 << 29) /* 2 turn/s per unit */
#define LAG_PROJECTED_MAX   (1 << 25) /* 1/8 turn/s per step of lag */
#define ANGULAR_STALE       4U        /* steps; the gyro's history lasts four of its periods */

/* Intermediate values of one step. */
typedef struct {
    bool gyro, angular, gyro_lost, rest, shock;
    bool two_attitudes;          /* attitude layer: the attitudes turn each by its own sensor */
    int32_t age_q24;             /* of the gyro's sample */
    int32_t lagged_q34[3];       /* lagged increment at the sample's instant */
    int32_t expected_q28[3];     /* rate there, less what the lag takes off */
    int64_t turn_q60[3];         /* rotation of `attitude` in this step */
    int64_t turn_angular_q60[3]; /* of the angular accelerometer's attitude, or of both */
} turntable_step_t;

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

/* *x += gain * innovation, clamped to +-limit. */
KERNEL void correct_one(int32_t *x, int32_t gain_q28, int32_t innovation_q28, unsigned shift, int32_t limit) {
    *x = clamp_i32(add_scaled(*x, gain_q28, innovation_q28, shift), -limit, limit);
}

/* Correct rate and biases of one axis by a measurement. */
static void correct(plumb_turntable_words_t *w, unsigned i, const int32_t gain_q28[FUSION_ROWS],
                    int32_t innovation_q28) {
    correct_one(&w->rate_fused_turnps_q28[i], gain_q28[FUSION_RATE], innovation_q28, 28, RATE_MAX);
    correct_one(&w->bias_gyro_turnps_q34[i], gain_q28[FUSION_GYRO_BIAS], innovation_q28, 22, BIAS_MAX);
    correct_one(&w->bias_angular_turnps_q42[i], gain_q28[FUSION_ANGULAR_BIAS], innovation_q28, 16, BIAS_MAX);
}

/* A rotation of gain times innovation, turn Q60, within a quarter turn. */
static int64_t correction_q60(int32_t gain_q28, int32_t innovation_q28) {
    return 16 * within_i64(mul_i64(gain_q28, innovation_q28), (int64_t)1 << 54);
}

/* Merge the two attitudes into one. */
static void merge_attitudes(plumb_turntable_words_t *w) {
    w->attitude_angular = w->attitude;
    for (unsigned j = 0; j < FUSION_STATES; j++) {
        w->covariance_q64[FUSION_CELL(FUSION_DIFFERENCE, j)] = 0;
    }
    w->covariance_q64[FUSION_CELL(FUSION_ANGLE, FUSION_DIFFERENCE)] = 0;
}

/* At rest: measurement update with rate 0, so that the sensors' readings go into the biases. */
static void update_zero_rate(plumb_turntable_words_t *w) {
    int64_t *p = w->covariance_q64, u[FUSION_ROWS];
    int32_t gain[FUSION_ROWS];
    plumb_fusion_gains(u, plumb_fusion_project_state(p, FUSION_RATE, u) + STILL_Q64, gain);
    plumb_fusion_update(p, gain, u);
    for (unsigned i = 0; i < 3U; i++) {
        correct(w, i, gain, -w->rate_fused_turnps_q28[i]);
    }
    merge_attitudes(w);
    for (unsigned j = 0; j < FUSION_STATES; j++) {
        p[FUSION_CELL(FUSION_ANGLE, j)] = 0;
    }
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

/* Data layer: compare the gyro's sample with the predicted rate. */
static void compare_rates(plumb_turntable_words_t *w, const plumb_fusion_params_t *f, turntable_step_t *s) {
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
        correct(w, i, gain, w->innovation_turnps_q28[i]);
        if (f->layer == PLUMB_FUSION_DATA) {
            s->turn_q60[i] += correction_q60(gain[FUSION_ANGLE], w->innovation_turnps_q28[i]);
        }
    }
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
        correct(w, i, gain, innovation);
        correct_one(&w->rate_corrected_turnps_q28[i], gain[FUSION_GYRO_BIAS], -innovation, 28, RATE_MAX);
        turn_q60[i] = correction_q60(gain[FUSION_ANGLE], innovation);
        turn_angular_q60[i] =
            turn_q60[i] + mul_i64(add_scaled(0, gain[FUSION_DIFFERENCE], innovation, 28), f->dt_s_q32);
    }
    plumb_quaternion_rotate(&w->attitude, turn_q60);
    plumb_quaternion_rotate(&w->attitude_angular, turn_angular_q60);
}

/* Propagate both attitudes by one step. */
static void propagate_attitude(plumb_turntable_words_t *w, const plumb_fusion_params_t *f,
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
        merge_attitudes(w);
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
        compare_rates(w, &p->fusion, &s);
    }
    propagate_attitude(w, &p->fusion, &s);
}
