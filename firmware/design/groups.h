/* Conversion of the groups of settings that systems share, with their checks in a fixed order.
 *
 * A design is a list of conversions. The first refusal is kept; the results of later conversions are
 * discarded. */
#ifndef PLUMB_DESIGN_GROUPS_H
#define PLUMB_DESIGN_GROUPS_H

#include "plumb/design.h"
#include "plumb/params.h"
#include "wide.h"
#include <float.h>
#include <stdbool.h>
#include <stddef.h>

#define DESIGN_WORD_MAX 2147483647 /* 2^31 - 1 */
#define DESIGN_DEG2     129600.0   /* square degrees of a square turn */
#define DESIGN_NO_LIMIT DBL_MAX    /* the most of a setting, or minus its least */

/* The finite members of *t, in the order in which they are checked; the name is the member's path. */
#define DESIGN_FINITE(design, t, member) plumb_design_finite(design, #member, (t)->member)

#define PLUMB_DESIGN_NONE_REFUSED {PLUMB_DESIGN_OK, NULL, 0.0, 0.0, 0.0, 0.0}

/* Record a refusal, if it is the first. least, most: what the setting may be while the others stay. */
void plumb_design_refuse(plumb_design_t *d, plumb_design_error_t error, const char *field, double asked,
                         double least, double most);

/* The square root of x, 0 to 2^800, within 2^-50 of itself. */
double plumb_design_root(double x);

void plumb_design_finite(plumb_design_t *d, const char *field, double x);

/* Refuse a value below 0. */
void plumb_design_not_negative(plumb_design_t *d, const char *field, double x);

/* A choice: 0 to last. */
void plumb_design_choice(plumb_design_t *d, const char *field, int32_t x, int32_t last);

/* period_us: within 500 to 100000. */
void plumb_design_period(plumb_design_t *d, int32_t period_us);

/* The integer nearest to `exact`, which is `asked` in the integer's unit, within low to high; refused where
 * that is more than 0.1 % beside it. low, high: within +-2^62. */
int64_t plumb_design_whole(plumb_design_t *d, const char *field, double asked, wide_t exact, int64_t low,
                           int64_t high);

/* The same where the integer is asked * scale. */
int64_t plumb_design_scaled(plumb_design_t *d, const char *field, double asked, wide_t scale, int64_t low,
                            int64_t high);

/* 1 - exp(-x), x >= 0, within 2^-48 of itself. */
double plumb_design_share(double x);

/* A setting of any size, moved to within +-2^400 and, other than 0, not below 2^-400: no integer sees the
 * difference. */
double plumb_design_bounded(double x);

/* period / 1 s, exact as numerator and denominator. */
static inline wide_t design_per_period(double x, int32_t period_us) {
    return wide_div(wide_product(x, (double)period_us), wide_of(1e6));
}

/* Names of the settings of a channel. */
typedef struct {
    const char *min_counts, *max_counts, *zero_counts, *unit_per_count;
} design_channel_names_t;

#define DESIGN_CHANNEL_NAMES(path)                                                                           \
    {path ".min_counts", path ".max_counts", path ".zero_counts", path ".unit_per_count"}

/* unit: integer units per engineering unit. */
void plumb_design_channel(plumb_design_t *d, const design_channel_names_t *names,
                          const plumb_channel_tuning_t *channel, wide_t unit,
                          plumb_calibration_params_t *words);

wide_t plumb_design_turn_unit(void); /* turn Q28 per degree */
wide_t plumb_design_g_unit(void);    /* g Q26 per g */

/* One two-state filter: its settings, and what they are called. */
typedef struct {
    double q_angle_deg2_per_s, q_bias_dps2_per_s, bias_max_dps;
    int32_t rate;
    plumb_trust_tuning_t trust; /* gain_deg2 0: r_max_deg2 stands in for a measurement that is left out */
    plumb_start_tuning_t start;
    const char *q_angle_name, *q_bias_name, *bias_max_name, *rate_name;
    const char *r_name, *gain_name, *r_max_name;
    const char *tilt_name, *bias_name, *p00_name, *p01_name, *p11_name;
} design_filter_t;

/* Its integers. tilt.mode is not touched. */
typedef struct {
    plumb_kalman_params_t kalman;
    plumb_kalman_start_t start;
    plumb_tilt_params_t tilt;
} design_filter_words_t;

/* Refuse settings that are invalid or contradict each other, before they are converted. */
void plumb_design_filter_check(plumb_design_t *d, const design_filter_t *f, int32_t period_us);

/* unit_deg2: the unit of variance, deg^2 per lsb; given where its hi is not 0, else found, the finest that
 * takes all variances with R a whole number where that is small. */
void plumb_design_filter(plumb_design_t *d, const design_filter_t *f, int32_t period_us, wide_t *unit_deg2,
                         design_filter_words_t *words);

/* Pulses, in order and within what speed controllers take. */
void plumb_design_esc(plumb_design_t *d, const plumb_esc_tuning_t *t, plumb_esc_params_t *words);

/* Conversions of declared settings (host/plumb/spec/settings.py), each within low to high. A formula: asked
 * times factor. */
int64_t plumb_design_formula(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                             int64_t high);

/* The same, where more than `high` is `high`. */
int64_t plumb_design_saturated(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                               int64_t high);

/* A formula of the square of a setting that is not negative. */
int64_t plumb_design_squared(plumb_design_t *d, const char *field, double asked, wide_t factor, int64_t low,
                             int64_t high);

/* A time as the nearest number of steps. */
int64_t plumb_design_steps(plumb_design_t *d, const char *field, double seconds, int32_t period_us,
                           int64_t low, int64_t high);

/* A whole number. */
int64_t plumb_design_number(plumb_design_t *d, const char *field, int32_t asked, int64_t low, int64_t high);

/* The sine of an angle from 0 to most_deg, at most 60, times scale. */
int64_t plumb_design_sine(plumb_design_t *d, const char *field, double deg, double scale, double most_deg,
                          int64_t high);

/* The share of a first-order filter, Q31, `high` for 0 s. Its time constant is least_periods to most_periods.
 */
int64_t plumb_design_filter_share(plumb_design_t *d, const char *field, double tau_s, int32_t period_us,
                                  double least_periods, double most_periods, int64_t high);

/* The settings that one-axis systems share: three channels, tilt, filter, controller. */
typedef struct {
    int32_t period_us, tilt;
    const plumb_calibration_tuning_t *calibration;
    const plumb_kalman_tuning_t *kalman;
    const plumb_trust_tuning_t *trust;
    const plumb_start_tuning_t *start;
    const plumb_pid_tuning_t *pid;
} design_axis_t;

/* Refuse settings that are not finite. Called before the checks of the system. */
void plumb_design_axis_finite(plumb_design_t *d, const design_axis_t *t);

void plumb_design_axis(plumb_design_t *d, const design_axis_t *t, plumb_params_t *params);

#endif
