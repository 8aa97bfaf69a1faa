#include "plumb/balancer.h"
#include "design/groups.h"

#define GRAVITY_MPS2     9.80665
#define WHEEL_SPEED_MOST ((int64_t)15 << 26) /* m/s Q26 */
#define EDGES_MOST       32767
#define LIMIT            ((int64_t)1 << 30)

static void wheel_words(plumb_design_t *d, const plumb_wheel_tuning_t *t, int32_t period_us,
                        plumb_wheel_params_t *words) {
    const wide_t steps_per_s = wide_div(wide_of(1e6), wide_of((double)period_us));
    const int64_t edge =
        plumb_design_scaled(d, "wheel.edge_m", t->edge_m, wide_mul(steps_per_s, wide_of(0x1p26)),
                            -WHEEL_SPEED_MOST, WHEEL_SPEED_MOST);
    const int64_t size = edge < 0 ? -edge : edge, fast = size != 0 ? WHEEL_SPEED_MOST / size : EDGES_MOST,
                  most = fast < EDGES_MOST ? fast : EDGES_MOST;
    if (t->edges_max < 0 || t->edges_max > most) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, "wheel.edges_max", (double)t->edges_max, 0.0,
                            (double)most);
    }
    double share;
    words->edges_max = t->edges_max != 0 ? t->edges_max : (int32_t)most;
    words->edge_mps_q26 = (int32_t)edge;
    words->alpha_q31 = plumb_design_filter_q31(d, "wheel.tau_s", t->tau_s, period_us, &share);
    plumb_design_not_negative(d, "wheel.accel_share", t->accel_share);
    const wide_t per_g = wide_div(wide_mul(wide_product(share, 0x1p30), steps_per_s), wide_of(GRAVITY_MPS2));
    words->accel_gain_q30 =
        (int32_t)plumb_design_scaled(d, "wheel.accel_share", t->accel_share, per_g, 0, DESIGN_WORD_MAX);
}

/* A plumb_pid_params_t of an error in m/s Q26 and a "rate" in g Q26, whose command is a share of the largest
 * lean.
 */
static void speed_words(plumb_design_t *d, const plumb_speed_tuning_t *t, int32_t period_us,
                        plumb_pid_params_t *words) {
    const char *const slew_name = "speed.lean_slew_dps";
    if (!(t->lean_max_deg > 0.0 && t->lean_max_deg <= 22.5)) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "speed.lean_max_deg", t->lean_max_deg, 0.0, 22.5);
        return;
    }
    const wide_t lean_max = wide_of(plumb_design_bounded(t->lean_max_deg));
    double share;
    if (t->lean_slew_dps <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, slew_name, t->lean_slew_dps, 0.0, DESIGN_NO_LIMIT);
    }
    words->d_alpha_q31 = plumb_design_filter_q31(d, "speed.accel_tau_s", t->accel_tau_s, period_us, &share);
    words->kp_q22 = (int32_t)plumb_design_scaled(d, "speed.lean_deg_per_mps", t->lean_deg_per_mps,
                                                 wide_div(wide_of(0x1p28), lean_max), -LIMIT, LIMIT);
    words->ki_dt_q22 = (int32_t)plumb_design_scaled(d, "speed.lean_deg_per_m", t->lean_deg_per_m,
                                                    wide_div(design_per_period(0x1p28, period_us), lean_max),
                                                    0, DESIGN_WORD_MAX);
    words->kd_q27 = (int32_t)plumb_design_scaled(d, "speed.lean_deg_per_g", t->lean_deg_per_g,
                                                 wide_div(wide_of(0x1p29), lean_max), -LIMIT, LIMIT);
    wide_t slew = wide_div(design_per_period(plumb_design_bounded(t->lean_slew_dps), period_us), lean_max);
    slew = wide_compare(slew, wide_of(2.0)) > 0 ? wide_of(2.0) : slew;
    words->slew_q22 = (int32_t)plumb_design_whole(d, slew_name, t->lean_slew_dps,
                                                  wide_mul(slew, wide_of(0x1p22)), 1, 1 << 23);
}

static void drive_words(plumb_design_t *d, const plumb_drive_tuning_t *t, const plumb_speed_tuning_t *speed,
                        plumb_drive_params_t *words) {
    plumb_design_not_negative(d, "drive.duty_max", t->duty_max);
    plumb_design_not_negative(d, "drive.fall_deg", t->fall_deg);
    words->speed_max_mps_q26 = (int32_t)plumb_design_scaled(d, "speed.speed_max_mps", speed->speed_max_mps,
                                                            wide_of(0x1p26), 0, (int64_t)8 << 26);
    words->lean_max_turn_q34 = (int32_t)plumb_design_scaled(
        d, "speed.lean_max_deg", speed->lean_max_deg, wide_div(wide_of(0x1p34), wide_of(360.0)), 1, LIMIT);
    words->span_q15 = (int32_t)plumb_design_scaled(d, "drive.span", t->span, wide_of(32768.0), -32767, 32767);
    words->duty_max_q15 =
        (int32_t)plumb_design_scaled(d, "drive.duty_max", t->duty_max, wide_of(32768.0), 0, 32767);
    words->fall_turn_q32 = (uint32_t)plumb_design_scaled(
        d, "drive.fall_deg", t->fall_deg, wide_div(wide_of(0x1p32), wide_of(360.0)), 0, (int64_t)1 << 31);
}

plumb_design_t plumb_balancer_design(const plumb_balancer_tuning_t *tuning, plumb_params_t *params) {
    const plumb_balancer_tuning_t *t = tuning;
    const design_axis_t axis = {t->period_us, t->tilt,   &t->calibration, &t->kalman,
                                &t->trust,    &t->start, &t->pid};
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    plumb_design_axis_finite(&d, &axis);
    DESIGN_FINITE(&d, t, wheel.edge_m);
    DESIGN_FINITE(&d, t, wheel.tau_s);
    DESIGN_FINITE(&d, t, wheel.accel_share);
    DESIGN_FINITE(&d, t, speed.lean_deg_per_mps);
    DESIGN_FINITE(&d, t, speed.lean_deg_per_m);
    DESIGN_FINITE(&d, t, speed.lean_deg_per_g);
    DESIGN_FINITE(&d, t, speed.accel_tau_s);
    DESIGN_FINITE(&d, t, speed.lean_max_deg);
    DESIGN_FINITE(&d, t, speed.lean_slew_dps);
    DESIGN_FINITE(&d, t, speed.speed_max_mps);
    DESIGN_FINITE(&d, t, drive.span);
    DESIGN_FINITE(&d, t, drive.duty_max);
    DESIGN_FINITE(&d, t, drive.fall_deg);
    plumb_design_period(&d, t->period_us);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_BALANCER};
    plumb_design_axis(&d, &axis, &made);
    wheel_words(&d, &t->wheel, t->period_us, &made.wheel);
    speed_words(&d, &t->speed, t->period_us, &made.speed);
    drive_words(&d, &t->drive, &t->speed, &made.drive);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
