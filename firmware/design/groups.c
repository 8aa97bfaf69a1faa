#include "groups.h"

#define CALIBRATION_MOST 1879048192 /* 7 * 2^28 */

static double absolute(double x) {
    return x < 0.0 ? -x : x;
}

void plumb_design_refuse(plumb_design_t *d, plumb_design_error_t error, const char *field, double asked,
                         double least, double most) {
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    d->error = error;
    d->field = field;
    d->asked = asked;
    d->least = least;
    d->most = most;
}

/* Scaled by powers of 4 to [1, 4), where four steps of Newton from (1 + x) / 2 reach the last bit. */
double plumb_design_root(double x) {
    double scale = 1.0;
    if (!(x > 0.0)) {
        return 0.0;
    }
    for (; x >= 4.0; x *= 0.25) {
        scale *= 2.0;
    }
    for (; x < 1.0; x *= 4.0) {
        scale *= 0.5;
    }
    double root = 0.5 + 0.5 * x;
    for (int i = 0; i < 5; i++) {
        root = 0.5 * (root + x / root);
    }
    return root * scale;
}

void plumb_design_finite(plumb_design_t *d, const char *field, double x) {
    if (!(x - x == 0.0)) { /* inf - inf and NaN - NaN are NaN, which equals no number */
        plumb_design_refuse(d, PLUMB_DESIGN_NOT_FINITE, field, x, -DESIGN_NO_LIMIT, DESIGN_NO_LIMIT);
    }
}

void plumb_design_not_negative(plumb_design_t *d, const char *field, double x) {
    if (x < 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_NEGATIVE, field, x, 0.0, DESIGN_NO_LIMIT);
    }
}

void plumb_design_choice(plumb_design_t *d, const char *field, int32_t x, int32_t last) {
    if (x < 0 || x > last) {
        plumb_design_refuse(d, PLUMB_DESIGN_NO_CHOICE, field, (double)x, 0.0, (double)last);
    }
}

void plumb_design_period(plumb_design_t *d, int32_t period_us) {
    if (period_us < 500 || period_us > 100000) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "period_us", (double)period_us, 500.0, 1e5);
    }
}

double plumb_design_bounded(double x) {
    const double most = 0x1p400, least = 0x1p-400;
    if (x > most || x < -most) {
        return x > 0.0 ? most : -most;
    }
    if (x != 0.0 && x < least && x > -least) {
        return x > 0.0 ? least : -least;
    }
    return x;
}

/* Record that `asked`, which is `exact` in an integer of low to high, has no integer within 0.1 %. */
static void refuse_integer(plumb_design_t *d, const char *field, double asked, wide_t exact, int64_t low,
                           int64_t high) {
    if (exact.hi == 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, field, asked, 0.0, DESIGN_NO_LIMIT);
        return;
    }
    const double step = plumb_design_bounded(asked) / exact.hi, one = step * (double)low,
                 other = step * (double)high, coarse = 500.0 * absolute(step);
    const double least = one < other ? one : other, most = one < other ? other : one;
    if (wide_compare(exact, wide_of_int(high)) > 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_LARGE, field, asked, least, most);
    } else if (wide_compare(exact, wide_of_int(low)) < 0 && low != 1) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, field, asked, least, most);
    } else if (asked > 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_FINE, field, asked, coarse, most);
    } else {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_FINE, field, asked, least, -coarse);
    }
}

int64_t plumb_design_whole(plumb_design_t *d, const char *field, double asked, wide_t exact, int64_t low,
                           int64_t high) {
    int64_t nearest = wide_round(exact);
    nearest = nearest < low ? low : nearest > high ? high : nearest;
    const wide_t beside = wide_mul(wide_abs(wide_sub(wide_of_int(nearest), exact)), wide_of(1000.0));
    if (wide_compare(beside, wide_abs(exact)) > 0) {
        refuse_integer(d, field, asked, exact, low, high);
    }
    return nearest;
}

int64_t plumb_design_scaled(plumb_design_t *d, const char *field, double asked, wide_t scale, int64_t low,
                            int64_t high) {
    return plumb_design_whole(d, field, asked, wide_mul(wide_of(plumb_design_bounded(asked)), scale), low,
                              high);
}

/* Halved n times to y <= 1/8, the series y (1 - y/2 (1 - y/3 (... (1 - y/12)))), then n times e = e (2 - e),
 * which is 1 - exp(-2 y). With u = 2^-53: what the series leaves out is below y^12 / 13! < 2^-68 of it, its
 * last step and product round by 3 u; e (2 - e) rounds by 2 u and passes on (2 - 2 e) / (2 - e) <= 1 of the
 * error of e; n <= 9. Together 21 u, below 2^-48. Beyond 40 the rest is below u. */
double plumb_design_share(double x) {
    if (x > 40.0) {
        return 1.0;
    }
    int n = 0;
    for (; x > 0.125; x *= 0.5) {
        n++;
    }
    double e = 1.0;
    for (int k = 12; k >= 2; k--) {
        e = 1.0 - x / (double)k * e;
    }
    e *= x;
    for (; n > 0; n--) {
        e *= 2.0 - e;
    }
    return e;
}

wide_t plumb_design_turn_unit(void) {
    return wide_div(wide_of(268435456.0), wide_of(360.0));
}

wide_t plumb_design_g_unit(void) {
    return wide_of(67108864.0);
}

void plumb_design_channel(plumb_design_t *d, const design_channel_names_t *names,
                          const plumb_channel_tuning_t *channel, wide_t unit,
                          plumb_calibration_params_t *words) {
    const int32_t low = channel->min_counts, high = channel->max_counts;
    if (high < -32768 || high > 32767) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names->max_counts, (double)high, -32768.0, 32767.0);
    }
    if (low < -32768 || low > high) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names->min_counts, (double)low, -32768.0,
                            (double)high);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    const int64_t most = DESIGN_WORD_MAX;
    const int64_t gain =
        plumb_design_scaled(d, names->unit_per_count, channel->unit_per_count, unit, -most, most);
    const wide_t zero = wide_product(-plumb_design_bounded(channel->zero_counts), (double)gain);
    const int64_t offset = wide_round(zero); /* +-2^62 if it is larger; then the sum below is, too */
    const int64_t at_low = low * gain + offset, at_high = high * gain + offset;
    if (at_low > CALIBRATION_MOST || at_low < -CALIBRATION_MOST || at_high > CALIBRATION_MOST ||
        at_high < -CALIBRATION_MOST) {
        const double below = absolute((double)low - channel->zero_counts),
                     above = absolute((double)high - channel->zero_counts);
        const double reach = (double)CALIBRATION_MOST / unit.hi / (below > above ? below : above);
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, names->unit_per_count, channel->unit_per_count,
                            -reach, reach);
    }
    words->raw_min = low;
    words->raw_max = high;
    words->gain = (int32_t)gain;
    words->offset =
        (int32_t)plumb_design_whole(d, names->zero_counts, channel->zero_counts, zero, -most - 1, most);
}
