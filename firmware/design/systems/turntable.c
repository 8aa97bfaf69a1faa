#include "plumb/turntable.h"
#include "design/systems/turntable_settings.h"

#define WORD            ((int64_t)4294967295)
#define NO_SPIKE_COUNTS 131072.0 /* 2^17 */
#define DENOMINATOR_MAX 10000000U
#define PHASE_MAX_S     1e9 /* up to here the arithmetic is exact */

static double absolute(double x) {
    return x < 0.0 ? -x : x;
}

static int32_t spike(plumb_design_t *d, const plumb_prefilter_tuning_t *t, double unit_per_count,
                     const char *const names[2]) {
    if (t->spike <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names[0], t->spike, 0.0, DESIGN_NO_LIMIT);
    }
    if (unit_per_count == 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, names[1], unit_per_count, -DESIGN_NO_LIMIT,
                            DESIGN_NO_LIMIT);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return 0;
    }
    const double counts = t->spike / absolute(unit_per_count);
    const int64_t nearest = wide_round(wide_of(counts < NO_SPIKE_COUNTS ? counts : NO_SPIKE_COUNTS));
    return (int32_t)(nearest < 1 ? 1 : nearest);
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

static void fusion_words(plumb_design_t *d, const plumb_turntable_tuning_t *tuning, plumb_params_t *p) {
    const plumb_fusion_tuning_t *t = &tuning->fusion;
    plumb_fusion_params_t *w = &p->fusion;
    plumb_design_not_negative(d, "fusion.gyro_phase_s", t->gyro_phase_s);
    plumb_design_not_negative(d, "fusion.gyro_scale", t->gyro_scale);
    plumb_design_not_negative(d, "fusion.angular_scale", t->angular_scale);
    if (t->gyro_phase_s > PHASE_MAX_S) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "fusion.gyro_phase_s", t->gyro_phase_s, 0.0,
                            PHASE_MAX_S);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    const times_t time = times(d, t, tuning->period_us);
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    setting_words(d, tuning, wide_mul(time.dt_s, wide_of(4.0)), time.period, p);
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
    w->dt_s_q32 = (int32_t)wide_round(wide_mul(time.dt_s, wide_of(0x1p32)));
    w->step_hz_q16 = (int32_t)wide_round(wide_div(wide_of(65536.0), time.dt_s));
    w->gyro_period_step_q24 = (uint32_t)wide_round(wide_mul(time.period, wide_of(0x1p24)));
    w->gyro_age_step_q24 =
        age_q24 < (int64_t)w->gyro_period_step_q24 ? (uint32_t)age_q24 : w->gyro_period_step_q24 - 1U;
    w->gyro_samples_step_q30 = (int32_t)wide_round(wide_div(wide_of(0x1p30), time.period));
    w->lag_alpha_q31 = (int32_t)(alpha_q31 > DESIGN_WORD_MAX ? DESIGN_WORD_MAX : alpha_q31);
    w->share_q30 = (int32_t)wide_round(wide_mul(share, wide_of(0x1p30)));
    w->v_scale_q40 = scale_word(d, t, scale);
}

plumb_design_t plumb_turntable_design(const plumb_turntable_tuning_t *tuning, plumb_params_t *params) {
    static const design_channel_names_t gyro = DESIGN_CHANNEL_NAMES("gyro"),
                                        angular = DESIGN_CHANNEL_NAMES("angular");
    static const char *const of_gyro[2] = {"gyro_filter.spike", "gyro.unit_per_count"};
    static const char *const of_angular[2] = {"angular_filter.spike", "angular.unit_per_count"};
    const plumb_turntable_tuning_t *t = tuning;
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    settings_finite(&d, t);
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
    made.gyro_filter.spike_counts = spike(&d, &t->gyro_filter, t->gyro.unit_per_count, of_gyro);
    made.angular_filter.spike_counts = spike(&d, &t->angular_filter, t->angular.unit_per_count, of_angular);
    if (d.error == PLUMB_DESIGN_OK) {
        fusion_words(&d, t, &made);
    }
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
