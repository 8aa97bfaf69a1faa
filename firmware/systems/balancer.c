#include "plumb/balancer.h"
#include "core/axis.h"
#include "core/pid.h"
#include "core/wheel.h"
#include "generated/ranges.h"

SELDOM_CALLED void plumb_balancer_init(plumb_balancer_t *c, const plumb_params_t *p) {
    *c = (plumb_balancer_t){0};
    plumb_kalman_init(&c->words.kalman, &p->start);
    plumb_pid_init(&c->words.speed);
    plumb_pid_init(&c->words.pid);
}

void plumb_balancer_step(plumb_balancer_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint_mps_q26) {
    plumb_balancer_words_t *w = &c->words;
    const plumb_drive_params_t *drive = &p->drive;
    const uint32_t step = w->step + 1U;
    /* the count wraps; the first step has no count before it */
    const int32_t edges = step == 1U ? 0 : (int16_t)sub_wrap(raw[3], w->raw[3]);
    axis_record_raw(w->raw, raw);
    w->setpoint_mps_q26 = setpoint_mps_q26;

    uint32_t flags = 0;
    const int32_t rate = calibration_apply(&p->gyro, raw[0], &flags, PLUMB_BALANCER_FLAG_GYRO_CLAMPED);
    const int32_t accel_x = calibration_apply(&p->accel, raw[1], &flags, PLUMB_BALANCER_FLAG_ACCEL_X_CLAMPED);
    const int32_t accel_z =
        calibration_apply(&p->accel_up, raw[2], &flags, PLUMB_BALANCER_FLAG_ACCEL_Z_CLAMPED);
    flags |= wheel_step(&w->wheel, &p->wheel, edges) ? PLUMB_BALANCER_FLAG_WHEEL_CLAMPED : 0U;
    const int32_t driving = axis_driving_rate(&p->kalman, step == 1U, rate, w->rate_turnps_q28);
    const int32_t gravity_x = accel_x + w->wheel.accel_g_q26;
    w->step = step;
    w->rate_turnps_q28 = rate;
    w->accel_x_g_q26 = accel_x;
    w->accel_z_g_q26 = accel_z;
    w->gravity_x_g_q26 = gravity_x;
    w->clamped_steps += flags != 0U;

    axis_measurement_t measured = axis_measure(&p->tilt, gravity_x, accel_z);
    w->variance = measured.variance;
    if (c->blind) {
        measured.tilt_turn_q32 = w->tilt_turn_q32;
    }
    w->tilt_measured_turn_q32 = measured.tilt_turn_q32;

    const axis_estimate_t now = axis_filter(&w->kalman, &p->kalman, measured, driving, rate);
    w->tilt_turn_q32 = now.tilt_turn_q32;
    w->bias_turnps_q28 = now.bias_turnps_q28;
    w->rate_corrected_turnps_q28 = now.rate_corrected_turnps_q28;

    const int32_t wanted = clamp_i32(setpoint_mps_q26, -drive->speed_max_mps_q26, drive->speed_max_mps_q26);
    w->speed.error_turn_q32 = wanted - w->wheel.velocity_mps_q26;
    pid_step(&w->speed, &p->speed, w->speed.error_turn_q32, w->wheel.accel_g_q26);
    w->lean_turn_q32 = mulhi_i32(w->speed.command_q22 * 256, drive->lean_max_turn_q34);

    w->pid.error_turn_q32 = sub_wrap(w->lean_turn_q32, now.tilt_turn_q32);
    pid_step(&w->pid, &p->pid, w->pid.error_turn_q32, now.rate_corrected_turnps_q28);

    const bool fallen =
        (w->flags & PLUMB_BALANCER_FLAG_FALLEN) != 0U || abs_u32(now.tilt_turn_q32) > drive->fall_turn_q32;
    const int32_t duty = asr32(asr32(w->pid.command_q22, 6) * drive->span_q15 + (1 << 15), 16);
    w->duty_q15 = fallen ? 0 : clamp_i32(duty, -drive->duty_max_q15, drive->duty_max_q15);
    flags |= wanted != setpoint_mps_q26 ? PLUMB_BALANCER_FLAG_SETPOINT_CLAMPED : 0U;
    flags |= w->speed.excess_q22 != 0 ? PLUMB_BALANCER_FLAG_LEAN_LIMITED : 0U;
    flags |= w->pid.excess_q22 != 0 ? PLUMB_BALANCER_FLAG_COMMAND_LIMITED : 0U;
    w->flags = flags | (fallen ? PLUMB_BALANCER_FLAG_FALLEN : 0U);
}

SELDOM_CALLED void plumb_balancer_retune(plumb_balancer_t *c, const plumb_params_t *from,
                                         const plumb_params_t *to) {
    plumb_pid_retune(&c->words.speed, &from->speed, &to->speed);
    plumb_pid_retune(&c->words.pid, &from->pid, &to->pid);
}

SELDOM_CALLED bool plumb_balancer_params_valid(const plumb_params_t *p) {
    return plumb_calibration_valid(&p->gyro) && plumb_calibration_valid(&p->accel) &&
           plumb_calibration_valid(&p->accel_up) && plumb_wheel_valid(&p->wheel) &&
           plumb_tilt_valid(&p->tilt) && plumb_kalman_valid(&p->kalman, &p->start) &&
           plumb_pid_valid(&p->speed) && plumb_pid_valid(&p->pid) && drive_in_range(&p->drive);
}

/* A vehicle that is pushed and accelerates by up to 8 m/s^2. Held upright by hand it is not quite at rest. */
const plumb_plausibility_bounds_t plumb_balancer_plausibility = {
    PLUMB_PLAUSIBILITY_PLACES(plumb_balancer_words_t, setpoint_mps_q26, accel_x_g_q26, accel_z_g_q26),
    .accel_min_g2_q20 = 167772U,   /* 0.4 g */
    .accel_max_g2_q20 = 3397386U,  /* 1.8 g */
    .rest_min_g2_q20 = 849347U,    /* 0.9 g */
    .rest_max_g2_q20 = 1268777U,   /* 1.1 g */
    .rest_turnps_q28 = 7456540U,   /* 10 deg/s */
    .uneven_turn_q32 = 357913941U, /* 30 deg a step: rough ground and the motors' vibration give 17 */
    .ready_turn_q32 = 119304647U,  /* 10 deg */
};
