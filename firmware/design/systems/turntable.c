#include "plumb/turntable.h"
#include "design/groups.h"

#define WORD            ((int64_t)4294967295)
#define NO_SPIKE_COUNTS 131072.0 /* 2^17 */
#define DENOMINATOR_MAX 10000000U
#define PHASE_MAX_S     1e9 /* up to here the arithmetic is exact */

static double absolute(double x) {
    return x < 0.0 ? -x : x;
}

static void prefilter(plumb_design_t *d, const plumb_prefilter_tuning_t *t, double unit_per_count,
                      const char *const names[3], plumb_prefilter_params_t *words) {
    if (t->spike <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names[0], t->spike, 0.0, DESIGN_NO_LIMIT);
    }
    if (t->smooth <= 0.0 || t->smooth > 1.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names[1], t->smooth, 0.0, 1.0);
    }
    if (unit_per_count == 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, names[2], unit_per_count, -DESIGN_NO_LIMIT,
                            DESIGN_NO_LIMIT);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    const double counts = t->spike / absolute(unit_per_count);
    const int64_t nearest = wide_round(wide_of(counts < NO_SPIKE_COUNTS ? counts : NO_SPIKE_COUNTS));
    words->spike_counts = (int32_t)(nearest < 1 ? 1 : nearest);
    words->smooth_q16 = (int32_t)plumb_design_scaled(d, names[1], t->smooth, wide_of(65536.0), 1, 1 << 16);
}

/* The fraction nearest to x with a denominator up to 10^7, 2^-11 <= x < 1: by continued fractions, exact. */
static void nearest_fraction(double x, double *numerator, double *denominator) {
    uint64_t whole = 1, n, d;
    for (double y = x; y != (double)(uint64_t)y; y *= 2.0) {
        whole *= 2U;
        x = y * 2.0;
    }
    n = (uint64_t)x;
    d = whole;
    uint64_t p0 = 0, q0 = 1, p1 = 1, q1 = 0;
    while (whole > DENOMINATOR_MAX) {
        const uint64_t a = n / d, q2 = q0 + a * q1, p2 = p0 + a * p1, rest = n - a * d;
        if (q2 > DENOMINATOR_MAX) {
            const uint64_t k = (DENOMINATOR_MAX - q0) / q1;
            if (d * (q0 + k * q1) > whole / 2U) {
                p1 = p0 + k * p1;
                q1 = q0 + k * q1;
            }
            break;
        }
        p0 = p1;
        q0 = q1;
        p1 = p2;
        q1 = q2;
        n = d;
        d = rest;
    }
    *numerator = whole > DENOMINATOR_MAX ? (double)p1 : (double)n;
    *denominator = whole > DENOMINATOR_MAX ? (double)q1 : (double)whole;
}

/* What the words of the fusion are worked out from: dt in s, period of the gyro and lag in steps. */
typedef struct {
    wide_t dt_s, period, lag, age;
} times_t;

/* (asked DEG)^2 * factor * scale. */
static uint32_t square(plumb_design_t *d, const char *field, double asked, wide_t factor, double scale,
                       int64_t low, int64_t high) {
    const double x = plumb_design_bounded(asked);
    plumb_design_not_negative(d, field, asked);
    const wide_t exact = wide_mul(wide_mul(wide_product(x, x), factor), wide_of(scale));
    const bool refused = d->error != PLUMB_DESIGN_OK;
    const uint32_t word = (uint32_t)plumb_design_whole(d, field, asked, exact, low, high);
    if (!refused && d->error != PLUMB_DESIGN_OK) { /* the limits of the square, linear in it */
        d->least = plumb_design_root(x * d->least);
        d->most = plumb_design_root(x * d->most);
    }
    return word;
}

/* (gyro_scale^2 + angular_scale^2), Q40. */
static uint32_t scale_word(plumb_design_t *d, const plumb_fusion_tuning_t *t, wide_t scale) {
    const double angular = plumb_design_bounded(t->angular_scale), rest = angular * angular;
    const double most = (double)WORD / 0x1p40, least = 500.0 / 0x1p40;
    if (rest > most) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_LARGE, "fusion.angular_scale", t->angular_scale, 0.0,
                            plumb_design_root(most));
    }
    const bool refused = d->error != PLUMB_DESIGN_OK;
    const uint32_t word = (uint32_t)plumb_design_whole(d, "fusion.gyro_scale", t->gyro_scale,
                                                       wide_mul(scale, wide_of(0x1p40)), 0, WORD);
    if (!refused && d->error != PLUMB_DESIGN_OK) {
        d->least = d->error == PLUMB_DESIGN_TOO_FINE ? plumb_design_root(least - rest) : 0.0;
        d->most = plumb_design_root(most - rest);
    }
    return word;
}

/* The times, or a refusal. */
static times_t times(plumb_design_t *d, const plumb_fusion_tuning_t *t, int32_t period_us) {
    const wide_t us = wide_of((double)period_us);
    times_t out = {wide_div(us, wide_of(1e6)), wide_of(0.0), wide_of(0.0), wide_of(0.0)};
    const double dt_s = (double)period_us / 1e6, gyro_s = t->gyro_period_s;
    double p = 0.0, q = 1.0;
    if (gyro_s > 0.5 * dt_s && gyro_s < 32.0 * dt_s && gyro_s >= 0x1p-11) {
        nearest_fraction(gyro_s, &p, &q);
    }
    out.period = wide_div(wide_of(p * 1e6), wide_mul(wide_of(q), us));
    if (wide_compare(out.period, wide_of(1.0)) < 0 || wide_compare(out.period, wide_of(16.0)) > 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "fusion.gyro_period_s", gyro_s, dt_s, 16.0 * dt_s);
        return out;
    }
    out.lag = wide_div(wide_product(plumb_design_bounded(t->lag_s), 1e6), us);
    /* age = -(dt + phase) modulo the gyro's period, in units of 1e-6 / q s: there everything is exact */
    const wide_t late =
        wide_add(wide_mul(wide_product(plumb_design_bounded(t->gyro_phase_s), 1e6), wide_of(q)),
                 wide_mul(us, wide_of(q)));
    wide_t fraction;
    const int64_t periods = wide_floor(wide_div(late, wide_of(p * 1e6)), &fraction);
    wide_t age = wide_sub(wide_mul(wide_of_int(periods), wide_of(p * 1e6)), late); /* 0 or less */
    if (wide_compare(age, wide_of(0.0)) < 0) {
        age = wide_add(age, wide_of(p * 1e6));
    }
    out.age = wide_div(age, wide_mul(wide_of(q), us));
    return out;
}

static void variances(plumb_design_t *d, const plumb_fusion_tuning_t *t, const times_t *time, wide_t scale,
                      plumb_fusion_params_t *w) {
    const wide_t one = wide_of(1.0), deg2 = wide_div(one, wide_of(DESIGN_DEG2)), dt = time->dt_s;
    const wide_t deg2_dt = wide_mul(deg2, dt), deg2_per_sample = wide_div(deg2, wide_mul(time->period, dt));
    const wide_t four = wide_mul(wide_mul(dt, dt), wide_of(16.0));
    w->r_gyro_q44 = square(d, "fusion.gyro_dps", t->gyro_dps, deg2_per_sample, 0x1p44, 1 << 12, WORD);
    w->q_rate_q52 = square(d, "fusion.angular_dps2", t->angular_dps2, deg2_dt, 0x1p52, 0, WORD);
    w->q_rate_lost_q44 = square(d, "fusion.lost_dps2", t->lost_dps2, deg2_dt, 0x1p44, 0, WORD);
    w->q_gyro_bias_q60 = square(d, "fusion.gyro_walk_dps", t->gyro_walk_dps, deg2_dt, 0x1p60, 0, WORD);
    w->q_angular_bias_q64 =
        square(d, "fusion.angular_walk_dps2", t->angular_walk_dps2, wide_mul(deg2_dt, four), 0x1p64, 0, WORD);
    w->p_gyro_bias_q40 = square(d, "fusion.start_gyro_dps", t->start_gyro_dps, deg2, 0x1p40, 0, WORD);
    w->p_angular_bias_q52 =
        square(d, "fusion.start_angular_dps2", t->start_angular_dps2, wide_mul(deg2, four), 0x1p52, 0, WORD);
    w->v_scale_q40 = scale_word(d, t, scale);
    w->v_lag_q30 =
        square(d, "fusion.start_lag_s", t->start_lag_s, wide_div(one, wide_mul(dt, dt)), 0x1p30, 0, 1 << 30);
}

static void fusion_words(plumb_design_t *d, const plumb_fusion_tuning_t *t, int32_t period_us,
                         plumb_fusion_params_t *w) {
    plumb_design_choice(d, "fusion.layer", t->layer, PLUMB_TUNING_LAYER_PRINTED);
    plumb_design_not_negative(d, "fusion.rest_s", t->rest_s);
    plumb_design_not_negative(d, "fusion.lag_s", t->lag_s);
    plumb_design_not_negative(d, "fusion.gyro_phase_s", t->gyro_phase_s);
    plumb_design_not_negative(d, "fusion.gyro_scale", t->gyro_scale);
    plumb_design_not_negative(d, "fusion.angular_scale", t->angular_scale);
    plumb_design_not_negative(d, "fusion.start_lag_s", t->start_lag_s);
    if (t->gyro_phase_s > PHASE_MAX_S) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "fusion.gyro_phase_s", t->gyro_phase_s, 0.0,
                            PHASE_MAX_S);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    const times_t time = times(d, t, period_us);
    const wide_t us = wide_of((double)period_us);
    const double dt_s = (double)period_us / 1e6;
    const int64_t rest = wide_round(wide_div(wide_product(plumb_design_bounded(t->rest_s), 1e6), us));
    if (rest > WORD) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_LARGE, "fusion.rest_s", t->rest_s, 0.0, (double)WORD * dt_s);
    }
    if (wide_compare(time.lag, wide_of(16.0)) > 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "fusion.lag_s", t->lag_s, 0.0, 16.0 * dt_s);
    }
    if (wide_compare(wide_product(plumb_design_bounded(t->start_lag_s), 1e6), us) > 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "fusion.start_lag_s", t->start_lag_s, 0.0, dt_s);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    const double gyro = plumb_design_bounded(t->gyro_scale), angular = plumb_design_bounded(t->angular_scale);
    const wide_t of_gyro = wide_product(gyro, gyro),
                 scale = wide_add(of_gyro, wide_product(angular, angular));
    const wide_t share = scale.hi != 0.0 ? wide_div(of_gyro, scale) : wide_of(0.5);
    const double alpha = time.lag.hi != 0.0 ? plumb_design_share(1.0 / time.lag.hi) : 1.0;
    const int64_t age_q24 = wide_round(wide_mul(time.age, wide_of(0x1p24)));
    const int64_t alpha_q31 = wide_round(wide_of(alpha * 0x1p31));
    w->layer = (uint32_t)t->layer;
    w->dt_s_q32 = (int32_t)wide_round(wide_mul(time.dt_s, wide_of(0x1p32)));
    w->step_hz_q16 = (int32_t)wide_round(wide_div(wide_of(65536e6), us));
    w->gyro_period_step_q24 = (uint32_t)wide_round(wide_mul(time.period, wide_of(0x1p24)));
    w->gyro_age_step_q24 =
        age_q24 < (int64_t)w->gyro_period_step_q24 ? (uint32_t)age_q24 : w->gyro_period_step_q24 - 1U;
    w->gyro_samples_step_q30 = (int32_t)wide_round(wide_div(wide_of(0x1p30), time.period));
    w->rest_steps = (uint32_t)rest;
    w->lag_step_q24 = (int32_t)plumb_design_whole(d, "fusion.lag_s", t->lag_s,
                                                  wide_mul(time.lag, wide_of(0x1p24)), 0, (int64_t)1 << 28);
    w->lag_alpha_q31 = (int32_t)(alpha_q31 > DESIGN_WORD_MAX ? DESIGN_WORD_MAX : alpha_q31);
    w->share_q30 = (int32_t)wide_round(wide_mul(share, wide_of(0x1p30)));
    variances(d, t, &time, scale, w);
}

static void all_finite(plumb_design_t *d, const plumb_turntable_tuning_t *t) {
    DESIGN_FINITE(d, t, gyro.zero_counts);
    DESIGN_FINITE(d, t, gyro.unit_per_count);
    DESIGN_FINITE(d, t, angular.zero_counts);
    DESIGN_FINITE(d, t, angular.unit_per_count);
    DESIGN_FINITE(d, t, gyro_filter.spike);
    DESIGN_FINITE(d, t, gyro_filter.smooth);
    DESIGN_FINITE(d, t, angular_filter.spike);
    DESIGN_FINITE(d, t, angular_filter.smooth);
    DESIGN_FINITE(d, t, fusion.gyro_period_s);
    DESIGN_FINITE(d, t, fusion.gyro_phase_s);
    DESIGN_FINITE(d, t, fusion.rest_s);
    DESIGN_FINITE(d, t, fusion.lag_s);
    DESIGN_FINITE(d, t, fusion.gyro_dps);
    DESIGN_FINITE(d, t, fusion.angular_dps2);
    DESIGN_FINITE(d, t, fusion.lost_dps2);
    DESIGN_FINITE(d, t, fusion.gyro_walk_dps);
    DESIGN_FINITE(d, t, fusion.angular_walk_dps2);
    DESIGN_FINITE(d, t, fusion.start_gyro_dps);
    DESIGN_FINITE(d, t, fusion.start_angular_dps2);
    DESIGN_FINITE(d, t, fusion.gyro_scale);
    DESIGN_FINITE(d, t, fusion.angular_scale);
    DESIGN_FINITE(d, t, fusion.start_lag_s);
}

plumb_design_t plumb_turntable_design(const plumb_turntable_tuning_t *tuning, plumb_params_t *params) {
    static const design_channel_names_t gyro = DESIGN_CHANNEL_NAMES("gyro"),
                                        angular = DESIGN_CHANNEL_NAMES("angular");
    static const char *const of_gyro[3] = {"gyro_filter.spike", "gyro_filter.smooth", "gyro.unit_per_count"};
    static const char *const of_angular[3] = {"angular_filter.spike", "angular_filter.smooth",
                                              "angular.unit_per_count"};
    const plumb_turntable_tuning_t *t = tuning;
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    all_finite(&d, t);
    plumb_design_period(&d, t->period_us);
    if (t->period_us > 10000) {
        plumb_design_refuse(&d, PLUMB_DESIGN_OUT_OF_RANGE, "period_us", (double)t->period_us, 500.0, 1e4);
    }
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_TURNTABLE};
    plumb_design_channel(&d, &gyro, &t->gyro, plumb_design_turn_unit(), &made.gyro);
    plumb_design_channel(&d, &angular, &t->angular, plumb_design_turn_unit(), &made.angular);
    prefilter(&d, &t->gyro_filter, t->gyro.unit_per_count, of_gyro, &made.gyro_filter);
    prefilter(&d, &t->angular_filter, t->angular.unit_per_count, of_angular, &made.angular_filter);
    fusion_words(&d, &t->fusion, t->period_us, &made.fusion);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
