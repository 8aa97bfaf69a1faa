/* Conversions of declared settings. Limits of a refusal are those of the integer, converted back. */
#include "groups.h"

#define DEG 0.017453292519943295

int64_t plumb_design_formula(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                             int64_t high) {
    if (low >= 0) {
        plumb_design_not_negative(d, field, asked);
    }
    return plumb_design_scaled(d, field, asked, factor, low, high);
}

int64_t plumb_design_saturated(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                               int64_t high) {
    const wide_t exact = wide_mul(wide_of(plumb_design_bounded(asked)), factor), most = wide_of_int(high);
    if (low >= 0) {
        plumb_design_not_negative(d, field, asked);
    }
    return plumb_design_whole(d, field, asked, wide_compare(exact, most) > 0 ? most : exact, low, high);
}

int64_t plumb_design_squared(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                             int64_t high) {
    const double x = plumb_design_bounded(asked);
    plumb_design_not_negative(d, field, asked);
    const bool refused = d->error != PLUMB_DESIGN_OK;
    const int64_t word = plumb_design_whole(d, field, asked, wide_mul(wide_product(x, x), factor), low, high);
    if (!refused && d->error != PLUMB_DESIGN_OK) { /* the limits of the square, linear in it */
        d->least = plumb_design_root(x * d->least);
        d->most = plumb_design_root(x * d->most);
    }
    return word;
}

int64_t plumb_design_steps(plumb_design_t *d, const char *field, double seconds, int32_t period_us,
                           int64_t low, int64_t high) {
    const wide_t us = wide_product(plumb_design_bounded(seconds), 1e6);
    const int64_t steps = wide_round(wide_div(us, wide_of((double)period_us)));
    const double dt_s = (double)period_us / 1e6;
    plumb_design_not_negative(d, field, seconds);
    if (steps < low || steps > high) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, seconds, (double)low * dt_s,
                            (double)high * dt_s);
    }
    return steps < low ? low : steps > high ? high : steps;
}

int64_t plumb_design_number(plumb_design_t *d, const char *field, int32_t asked, int64_t low, int64_t high) {
    if (asked < low || asked > high) {
        plumb_design_refuse(d, PLUMB_DESIGN_NO_CHOICE, field, (double)asked, (double)low, (double)high);
        return low;
    }
    return asked;
}

/* The series to x^21: for x up to 1.05 what it leaves out is below 2^-70. */
int64_t plumb_design_sine(plumb_design_t *d, const char *field, double deg, double scale, double most_deg,
                          int64_t high) {
    plumb_design_not_negative(d, field, deg);
    if (deg > most_deg) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, deg, 0.0, most_deg);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return 0;
    }
    const double x = deg * DEG;
    double sum = 1.0;
    for (int k = 20; k >= 2; k -= 2) {
        sum = 1.0 - x * x / (double)(k * (k + 1)) * sum;
    }
    const int64_t nearest = wide_round(wide_of(x * sum * scale));
    return nearest < high ? nearest : high;
}

int64_t plumb_design_filter_share(plumb_design_t *d, const char *field, double tau_s, int32_t period_us,
                                  double least_periods, double most_periods, int64_t high) {
    const double dt_s = (double)period_us / 1e6, least_s = dt_s * least_periods, most_s = dt_s * most_periods;
    plumb_design_not_negative(d, field, tau_s);
    if (tau_s < least_s || tau_s > most_s) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, tau_s, least_s, most_s);
    }
    if (d->error != PLUMB_DESIGN_OK || tau_s == 0.0) {
        return high;
    }
    const int64_t nearest = wide_round(wide_of(plumb_design_share(dt_s / tau_s) * 0x1p31));
    return nearest < high ? nearest : high;
}
