/* The settings that one-axis systems share. */
#include "groups.h"
#include "pid_settings.h"

#define FINITE(group, member) plumb_design_finite(d, #group "." #member, t->group->member)

void plumb_design_axis_finite(plumb_design_t *d, const design_axis_t *t) {
    FINITE(calibration, gyro.zero_counts);
    FINITE(calibration, gyro.unit_per_count);
    FINITE(calibration, accel.zero_counts);
    FINITE(calibration, accel.unit_per_count);
    FINITE(calibration, accel_up.zero_counts);
    FINITE(calibration, accel_up.unit_per_count);
    FINITE(kalman, q_angle_deg2_per_s);
    FINITE(kalman, q_bias_dps2_per_s);
    FINITE(kalman, bias_max_dps);
    FINITE(trust, r_deg2);
    FINITE(trust, gain_deg2);
    FINITE(trust, r_max_deg2);
    FINITE(start, tilt_deg);
    FINITE(start, bias_dps);
    FINITE(start, p00_deg2);
    FINITE(start, p01_deg2_per_s);
    FINITE(start, p11_dps2);
    FINITE(pid, kp_per_deg);
    FINITE(pid, ki_per_deg_s);
    FINITE(pid, kd_per_dps);
    FINITE(pid, derivative_tau_s);
    FINITE(pid, slew_per_s);
}

void plumb_design_axis(plumb_design_t *d, const design_axis_t *t, plumb_params_t *params) {
    static const design_channel_names_t gyro = DESIGN_CHANNEL_NAMES("calibration.gyro");
    static const design_channel_names_t accel = DESIGN_CHANNEL_NAMES("calibration.accel");
    static const design_channel_names_t accel_up = DESIGN_CHANNEL_NAMES("calibration.accel_up");
    design_filter_t f = {
        .q_angle_deg2_per_s = t->kalman->q_angle_deg2_per_s,
        .q_bias_dps2_per_s = t->kalman->q_bias_dps2_per_s,
        .bias_max_dps = t->kalman->bias_max_dps,
        .rate = t->kalman->rate,
        .trust = *t->trust,
        .start = *t->start,
        .q_angle_name = "kalman.q_angle_deg2_per_s",
        .q_bias_name = "kalman.q_bias_dps2_per_s",
        .bias_max_name = "kalman.bias_max_dps",
        .rate_name = "kalman.rate",
        .r_name = "trust.r_deg2",
        .gain_name = "trust.gain_deg2",
        .r_max_name = "trust.r_max_deg2",
        .tilt_name = "start.tilt_deg",
        .bias_name = "start.bias_dps",
        .p00_name = "start.p00_deg2",
        .p01_name = "start.p01_deg2_per_s",
        .p11_name = "start.p11_dps2",
    };
    if (f.trust.gain_deg2 == 0.0) {
        f.trust.r_max_deg2 = f.trust.r_deg2;
    }
    plumb_design_choice(d, "tilt", t->tilt, PLUMB_TUNING_ATAN2);
    plumb_design_filter_check(d, &f, t->period_us);
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    design_filter_words_t words = {.tilt = {.mode = (uint32_t)t->tilt}};
    wide_t unit_deg2 = wide_of(0.0);
    plumb_design_filter(d, &f, t->period_us, &unit_deg2, &words);
    params->kalman = words.kalman;
    params->start = words.start;
    params->tilt = words.tilt;
    plumb_design_channel(d, &gyro, &t->calibration->gyro, plumb_design_turn_unit(), &params->gyro);
    plumb_design_channel(d, &accel, &t->calibration->accel, plumb_design_g_unit(), &params->accel);
    plumb_design_channel(d, &accel_up, &t->calibration->accel_up, plumb_design_g_unit(), &params->accel_up);
    pid_words(d, t->pid, t->period_us, &params->pid);
}
