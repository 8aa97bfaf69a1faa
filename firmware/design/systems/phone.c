#include "plumb/phone.h"
#include "design/groups.h"

/* The settings of one angle's filter, and their names. */
#define AXIS_FILTER(t, axis)                                                                                 \
    {                                                                                                        \
        .q_angle_deg2_per_s = (t)->axis.q_angle_deg2_per_s,                                                  \
        .q_bias_dps2_per_s = (t)->axis.q_bias_dps2_per_s,                                                    \
        .bias_max_dps = (t)->bias_max_dps,                                                                   \
        .rate = (t)->rate,                                                                                   \
        .trust = {(t)->axis.r_deg2, 0.0, (t)->r_left_out_deg2},                                              \
        .start = (t)->axis.start,                                                                            \
        .q_angle_name = #axis ".q_angle_deg2_per_s",                                                         \
        .q_bias_name = #axis ".q_bias_dps2_per_s",                                                           \
        .bias_max_name = "bias_max_dps",                                                                     \
        .rate_name = "rate",                                                                                 \
        .r_name = #axis ".r_deg2",                                                                           \
        .r_max_name = "r_left_out_deg2",                                                                     \
        .tilt_name = #axis ".start.tilt_deg",                                                                \
        .bias_name = #axis ".start.bias_dps",                                                                \
        .p00_name = #axis ".start.p00_deg2",                                                                 \
        .p01_name = #axis ".start.p01_deg2_per_s",                                                           \
        .p11_name = #axis ".start.p11_dps2",                                                                 \
    }

/* One filter; unit_deg2 as plumb_design_filter takes it. */
static void one(plumb_design_t *d, const plumb_phone_tuning_t *t, const design_filter_t *f, wide_t *unit_deg2,
                design_filter_words_t *words) {
    if (t->r_left_out_deg2 < f->trust.r_deg2) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, "r_left_out_deg2", t->r_left_out_deg2,
                            f->trust.r_deg2, DESIGN_NO_LIMIT);
    }
    if (d->error == PLUMB_DESIGN_OK) {
        plumb_design_filter_check(d, f, t->period_us);
    }
    if (d->error == PLUMB_DESIGN_OK) {
        plumb_design_filter(d, f, t->period_us, unit_deg2, words);
    }
}

/* Both filters count their variances in one unit: that which suits pitch, or else roll. */
static void filters(plumb_design_t *d, const plumb_phone_tuning_t *t, design_filter_words_t *pitch,
                    design_filter_words_t *roll) {
    const design_filter_t of_pitch = AXIS_FILTER(t, pitch), of_roll = AXIS_FILTER(t, roll);
    plumb_design_t by_pitch = *d, by_roll = *d;
    wide_t unit_deg2 = wide_of(0.0);
    one(&by_pitch, t, &of_pitch, &unit_deg2, pitch);
    one(&by_pitch, t, &of_roll, &unit_deg2, roll);
    if (by_pitch.error != PLUMB_DESIGN_OK) {
        unit_deg2 = wide_of(0.0);
        one(&by_roll, t, &of_roll, &unit_deg2, roll);
        one(&by_roll, t, &of_pitch, &unit_deg2, pitch);
    }
    *d = by_pitch.error == PLUMB_DESIGN_OK || by_roll.error != PLUMB_DESIGN_OK ? by_pitch : by_roll;
}

static void axis_finite(plumb_design_t *d, const plumb_phone_tuning_t *t) {
    DESIGN_FINITE(d, t, gyro.zero_counts);
    DESIGN_FINITE(d, t, gyro.unit_per_count);
    DESIGN_FINITE(d, t, accel.zero_counts);
    DESIGN_FINITE(d, t, accel.unit_per_count);
    DESIGN_FINITE(d, t, pitch.q_angle_deg2_per_s);
    DESIGN_FINITE(d, t, pitch.q_bias_dps2_per_s);
    DESIGN_FINITE(d, t, pitch.r_deg2);
    DESIGN_FINITE(d, t, pitch.start.tilt_deg);
    DESIGN_FINITE(d, t, pitch.start.bias_dps);
    DESIGN_FINITE(d, t, pitch.start.p00_deg2);
    DESIGN_FINITE(d, t, pitch.start.p01_deg2_per_s);
    DESIGN_FINITE(d, t, pitch.start.p11_dps2);
    DESIGN_FINITE(d, t, roll.q_angle_deg2_per_s);
    DESIGN_FINITE(d, t, roll.q_bias_dps2_per_s);
    DESIGN_FINITE(d, t, roll.r_deg2);
    DESIGN_FINITE(d, t, roll.start.tilt_deg);
    DESIGN_FINITE(d, t, roll.start.bias_dps);
    DESIGN_FINITE(d, t, roll.start.p00_deg2);
    DESIGN_FINITE(d, t, roll.start.p01_deg2_per_s);
    DESIGN_FINITE(d, t, roll.start.p11_dps2);
    DESIGN_FINITE(d, t, r_left_out_deg2);
    DESIGN_FINITE(d, t, bias_max_dps);
}

plumb_design_t plumb_phone_design(const plumb_phone_tuning_t *tuning, plumb_params_t *params) {
    static const design_channel_names_t gyro = DESIGN_CHANNEL_NAMES("gyro"),
                                        accel = DESIGN_CHANNEL_NAMES("accel");
    const plumb_phone_tuning_t *t = tuning;
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    axis_finite(&d, t);
    plumb_design_period(&d, t->period_us);
    plumb_design_choice(&d, "rates", t->rates, PLUMB_TUNING_RATES_EULER);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_PHONE, .phone = {.rates = (uint32_t)t->rates}};
    design_filter_words_t pitch = {.tilt = {.mode = PLUMB_TUNING_ATAN2}}, roll = pitch;
    filters(&d, t, &pitch, &roll);
    made.tilt = pitch.tilt;
    made.kalman = pitch.kalman;
    made.start = pitch.start;
    made.roll.r_base = roll.tilt.r_base;
    made.roll.r_max = roll.tilt.r_max;
    made.roll.qa_hi = roll.kalman.qa_hi;
    made.roll.qa_lo = roll.kalman.qa_lo;
    made.roll.qb = roll.kalman.qb;
    made.roll.qb_frac_q30 = roll.kalman.qb_frac_q30;
    made.roll.start = roll.start;
    plumb_design_channel(&d, &gyro, &t->gyro, plumb_design_turn_unit(), &made.gyro);
    plumb_design_channel(&d, &accel, &t->accel, plumb_design_g_unit(), &made.accel);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
