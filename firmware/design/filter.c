/* Converts the settings of the two-state filter to integers. The one free choice is the unit of variance, the
 * "lsb": as fine as the largest variance allows, and, for a small R, such that R is a whole number of 2^32
 * lsb. */
#include "groups.h"

#define VARIANCE_MAX ((int64_t)1 << 56) /* of qa, p11 and |p01| in lsb; p00 may start at twice as much */
#define R_MOST       ((int64_t)1 << 24) /* of R, in 2^32 lsb */
#define QB_MOST      (((int64_t)1 << 62) - 1)
#define BIAS_MOST    ((((int64_t)1 << 26) - 1) << 32) /* of the start's bias per step, turn Q61 */
#define HALF_TURN    ((int64_t)1 << 31)
#define UNITS_MOST   4000 /* whole numbers of R that are tried */

enum { R, R_LEFT_OUT, Q_ANGLE, Q_BIAS, P00, P01, P11, VARIANCES };

/* A setting, and the same in deg^2 with the bias per step. */
typedef struct {
    const char *name;
    double asked;
    wide_t deg2;
} variance_t;

/* x * period^power, power 0 to 3. */
static wide_t per_step(double x, int32_t period_us, int power) {
    double numerator = 1.0, denominator = 1.0;
    for (int i = 0; i < power; i++) {
        numerator *= (double)period_us;
        denominator *= 1e6;
    }
    return wide_div(wide_product(plumb_design_bounded(x), numerator), wide_of(denominator));
}

static void variances(variance_t v[VARIANCES], const design_filter_t *f, int32_t period_us) {
    const plumb_start_tuning_t *s = &f->start;
    const variance_t all[VARIANCES] = {
        {f->r_name, f->trust.r_deg2, per_step(f->trust.r_deg2, period_us, 0)},
        {f->r_max_name, f->trust.r_max_deg2, per_step(f->trust.r_max_deg2, period_us, 0)},
        {f->q_angle_name, f->q_angle_deg2_per_s, per_step(f->q_angle_deg2_per_s, period_us, 1)},
        {f->q_bias_name, f->q_bias_dps2_per_s, per_step(f->q_bias_dps2_per_s, period_us, 3)},
        {f->p00_name, s->p00_deg2, per_step(s->p00_deg2, period_us, 0)},
        {f->p01_name, s->p01_deg2_per_s, per_step(s->p01_deg2_per_s, period_us, 1)},
        {f->p11_name, s->p11_dps2, per_step(s->p11_dps2, period_us, 2)},
    };
    for (int i = 0; i < VARIANCES; i++) {
        v[i] = all[i];
    }
}

void plumb_design_filter_check(plumb_design_t *d, const design_filter_t *f, int32_t period_us) {
    const plumb_start_tuning_t *s = &f->start;
    plumb_design_choice(d, f->rate_name, f->rate, PLUMB_TUNING_RATE_TRAPEZIUM);
    plumb_design_not_negative(d, f->q_angle_name, f->q_angle_deg2_per_s);
    plumb_design_not_negative(d, f->q_bias_name, f->q_bias_dps2_per_s);
    plumb_design_not_negative(d, f->bias_max_name, f->bias_max_dps);
    plumb_design_not_negative(d, f->p00_name, s->p00_deg2);
    plumb_design_not_negative(d, f->p11_name, s->p11_dps2);
    plumb_design_not_negative(d, f->gain_name, f->trust.gain_deg2);
    if (f->trust.r_deg2 <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, f->r_name, f->trust.r_deg2, 1e-100, 1e100);
    }
    if (f->trust.gain_deg2 != 0.0 && f->trust.r_max_deg2 < f->trust.r_deg2) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, f->r_max_name, f->trust.r_max_deg2, f->trust.r_deg2,
                            DESIGN_NO_LIMIT);
    }
    const double p00 = plumb_design_bounded(s->p00_deg2), p01 = plumb_design_bounded(s->p01_deg2_per_s);
    const double p11 = plumb_design_bounded(s->p11_dps2),
                 product = plumb_design_root(p00) * plumb_design_root(p11);
    const double reach = p00 / ((double)period_us * 1e-6), quarter = f->q_angle_deg2_per_s / 4.0;
    const double lowest = reach < product ? reach : product, highest = quarter < lowest ? quarter : lowest;
    if (wide_compare(wide_product(p01, p01), wide_product(p00, p11)) > 0 || p01 < -reach || p01 > reach ||
        p01 > quarter) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, f->p01_name, s->p01_deg2_per_s, -lowest, highest);
    }
    if (f->bias_max_dps >= 360.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, f->bias_max_name, f->bias_max_dps, 0.0, 360.0);
    }
    if (s->bias_dps > f->bias_max_dps || -s->bias_dps > f->bias_max_dps) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, f->bias_name, s->bias_dps, -f->bias_max_dps,
                            f->bias_max_dps);
    }
    if (f->trust.r_deg2 < 1e-100 || f->trust.r_deg2 > 1e100) { /* where bounded variances lose their ratio */
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, f->r_name, f->trust.r_deg2, 1e-100, 1e100);
    }
}

static int64_t square_root(int64_t x) {
    int64_t root = 0;
    for (int64_t bit = (int64_t)1 << 31; bit != 0; bit >>= 1) {
        if ((root + bit) <= x / (root + bit)) {
            root += bit;
        }
    }
    return root;
}

/* R of the deviation d = | |a|^2 - 1 |, g^2 Q20, clamped just above where R reaches its limit, shifted up as
 * far as 32 bits and the resolution of r_gain allow. */
static void gain_words(plumb_design_t *d, const design_filter_t *f, wide_t unit, plumb_tilt_params_t *words) {
    words->r_gain = words->deviation_max = words->deviation_shift = 0;
    if (f->trust.gain_deg2 == 0.0) {
        return;
    }
    const wide_t gain =
        wide_div(wide_of(plumb_design_bounded(f->trust.gain_deg2)), wide_mul(unit, wide_of(0x1p32)));
    const wide_t reach = wide_div(wide_of(((double)words->r_max - (double)words->r_base) * 0x1p40), gain);
    wide_t fraction;
    int64_t square = wide_floor(reach, &fraction);
    square += fraction.hi > 0.0 ? 1 : 0;
    int64_t most = square_root(square) + 2;
    most = most > DESIGN_WORD_MAX ? DESIGN_WORD_MAX : most;
    int length = 0;
    while (most >> length != 0) {
        length++;
    }
    int shift = 32 - length > 31 ? 31 : 32 - length;
    wide_t exact;
    double scale = 16777216.0; /* 2^(24 - 2 shift) */
    for (int i = 0; i < shift; i++) {
        scale /= 4.0;
    }
    for (; exact = wide_mul(gain, wide_of(scale)), shift > 0 && wide_compare(exact, wide_of(2000.0)) <= 0;
         shift--) {
        scale *= 4.0;
    }
    words->r_gain = (uint32_t)plumb_design_whole(d, f->gain_name, f->trust.gain_deg2, exact, 0, 4294967295);
    words->deviation_max = (uint32_t)most;
    words->deviation_shift = (uint32_t)shift;
}

static uint32_t low_word(int64_t x) {
    return (uint32_t)((uint64_t)x & 0xFFFFFFFFU);
}

/* floor(x / 2^32), without a shift of a negative number. */
static int32_t high_word(int64_t x) {
    return (int32_t)((x - (int64_t)low_word(x)) / 4294967296);
}

static void in_unit(plumb_design_t *d, const design_filter_t *f, const variance_t v[VARIANCES], wide_t unit,
                    design_filter_words_t *w) {
    const struct {
        int64_t low, high;
        double scale;
    } range[VARIANCES] = {
        {1, R_MOST, 0x1p-32},       {1, R_MOST, 0x1p-32},       {0, VARIANCE_MAX, 1.0},
        {0, QB_MOST, 0x1p30},       {0, 2 * VARIANCE_MAX, 1.0}, {-VARIANCE_MAX, VARIANCE_MAX, 1.0},
        {0, VARIANCE_MAX - 1, 1.0},
    };
    static const int order[VARIANCES] = {R, R_LEFT_OUT, Q_ANGLE, Q_BIAS, P00, P11, P01};
    int64_t lsb[VARIANCES];
    for (int i = 0; i < VARIANCES; i++) {
        const int j = order[i];
        const wide_t exact = wide_mul(wide_div(v[j].deg2, unit), wide_of(range[j].scale));
        lsb[j] = plumb_design_whole(d, v[j].name, v[j].asked, exact, range[j].low, range[j].high);
    }
    w->tilt.r_base = (uint32_t)lsb[R];
    w->tilt.r_max = (uint32_t)lsb[R_LEFT_OUT];
    gain_words(d, f, unit, &w->tilt);
    w->kalman.qa_hi = (uint32_t)high_word(lsb[Q_ANGLE]);
    w->kalman.qa_lo = low_word(lsb[Q_ANGLE]);
    w->kalman.qb = (uint32_t)(lsb[Q_BIAS] >> 30);
    w->kalman.qb_frac_q30 = (uint32_t)(lsb[Q_BIAS] & 0x3FFFFFFF);
    w->start.p00_hi = (uint32_t)high_word(lsb[P00]);
    w->start.p00_lo = low_word(lsb[P00]);
    w->start.p01_hi = high_word(lsb[P01]);
    w->start.p01_lo = low_word(lsb[P01]);
    w->start.p11_hi = (uint32_t)high_word(lsb[P11]);
    w->start.p11_lo = low_word(lsb[P11]);
}

/* The units that may be, the finest first; *unit is the first that takes all variances. */
static void find_unit(plumb_design_t *d, const design_filter_t *f, const variance_t v[VARIANCES],
                      wide_t *unit, design_filter_words_t *w) {
    static const double limit[VARIANCES] = {0.0,    0x1p56, 0x1p56, 0x1p32,
                                            0x1p57, 0x1p56, 0x1p56}; /* R_MOST << 32 */
    wide_t finest = wide_of(0.0);
    for (int i = R_LEFT_OUT; i < VARIANCES; i++) {
        const wide_t one = wide_div(wide_abs(v[i].deg2), wide_of(limit[i]));
        if (wide_compare(one, finest) > 0) {
            finest = one;
        }
    }
    const wide_t r_most = wide_div(v[R].deg2, wide_mul(finest, wide_of(0x1p32)));
    const wide_t most = wide_div(wide_mul(r_most, wide_of(2001.0)), wide_of(2000.0));
    if (wide_compare(most, wide_of(1.0)) < 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, f->r_name, f->trust.r_deg2,
                            f->trust.r_deg2 / r_most.hi, 1e100);
        return;
    }
    plumb_design_t first = PLUMB_DESIGN_NONE_REFUSED;
    wide_t fraction;
    const int64_t top = wide_floor(most, &fraction);
    const bool try_finest = wide_compare(r_most, wide_of(2000.0)) > 0;
    for (int64_t whole = (top > UNITS_MOST ? UNITS_MOST : top) + (try_finest ? 1 : 0), i = whole; i > 0;
         i--) {
        *unit = try_finest && i == whole ? finest : wide_div(v[R].deg2, wide_of((double)i * 0x1p32));
        plumb_design_t trial = PLUMB_DESIGN_NONE_REFUSED;
        in_unit(&trial, f, v, *unit, w);
        if (trial.error == PLUMB_DESIGN_OK) {
            return;
        }
        if (first.error == PLUMB_DESIGN_OK) {
            first = trial;
        }
    }
    plumb_design_refuse(d, first.error, first.field, first.asked, first.least, first.most);
}

void plumb_design_filter(plumb_design_t *d, const design_filter_t *f, int32_t period_us, wide_t *unit_deg2,
                         design_filter_words_t *words) {
    variance_t v[VARIANCES];
    variances(v, f, period_us);
    if (unit_deg2->hi == 0.0) {
        find_unit(d, f, v, unit_deg2, words);
    } else {
        in_unit(d, f, v, *unit_deg2, words);
    }
    d->lsb_deg2 = unit_deg2->hi + unit_deg2->lo;

    const wide_t dt_deg = wide_div(wide_of((double)period_us), wide_of(360e6)); /* turn per step of 1 deg/s */
    const int64_t tilt = plumb_design_scaled(
        d, f->tilt_name, f->start.tilt_deg, wide_div(wide_of(0x1p32), wide_of(360.0)), -HALF_TURN, HALF_TURN);
    words->start.tilt_turn_q32 = (int32_t)(tilt == HALF_TURN ? -HALF_TURN : tilt);
    words->kalman.dt_s_q33 = (int32_t)wide_round(wide_div(wide_of((double)period_us * 0x1p33), wide_of(1e6)));
    words->kalman.rate_now = (uint32_t)f->rate;
    words->kalman.bias_max_turn_q29 = (int32_t)plumb_design_scaled(
        d, f->bias_max_name, f->bias_max_dps, wide_mul(dt_deg, wide_of(0x1p29)), 0, HALF_TURN - 1);
    uint32_t shift = 0;
    while (1000000 / period_us >> shift != 0) {
        shift++;
    }
    const int64_t gain = wide_round(
        wide_div(wide_of(1e6 * (double)((int64_t)1 << (31U - shift))), wide_of((double)period_us)));
    words->kalman.rate_gain = (int32_t)(gain > DESIGN_WORD_MAX ? DESIGN_WORD_MAX : gain);
    words->kalman.rate_shift = shift;
    const int64_t bias = plumb_design_scaled(d, f->bias_name, f->start.bias_dps,
                                             wide_mul(dt_deg, wide_of(0x1p61)), -BIAS_MOST, BIAS_MOST);
    words->start.bias_hi = high_word(bias);
    words->start.bias_lo = low_word(bias);
}
