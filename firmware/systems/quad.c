#include "plumb/quad.h"
#include "core/axis.h"
#include "core/esc.h"
#include "core/pid.h"

SELDOM_CALLED void plumb_quad_init(plumb_quad_t *c, const plumb_params_t *p) {
    *c = (plumb_quad_t){0};
    plumb_kalman_init(&c->words.kalman, &p->start);
    plumb_pid_init(&c->words.pid);
}

static inline void pulses(uint32_t pulse_halfus[2], const plumb_esc_params_t *p, int32_t command_q22) {
    int32_t mid = p->mid_halfus, low = p->min_halfus, high = p->max_halfus, span = p->span_halfus;
    LOADED4(mid, low, high, span);
    const int32_t thrust = asr32(asr32(command_q22, 6) * span + (1 << 15), 16);
    const int32_t first = clamp_i32(mid + thrust, low, high);
    const int32_t second = clamp_i32(mid - thrust, low, high);
    pulse_halfus[0] = (uint32_t)first;
    pulse_halfus[1] = (uint32_t)second;
}

void plumb_quad_step(plumb_quad_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                     int32_t setpoint_turn_q32) {
    plumb_quad_words_t *w = &c->words;
    axis_record_raw(w->raw, raw);
    w->setpoint_turn_q32 = setpoint_turn_q32;

    uint32_t flags = 0;
    const int32_t rate = calibration_apply(&p->gyro, raw[0], &flags, PLUMB_QUAD_FLAG_GYRO_CLAMPED);
    const int32_t accel_y = calibration_apply(&p->accel, raw[1], &flags, PLUMB_QUAD_FLAG_ACCEL_Y_CLAMPED);
    const int32_t accel_z = calibration_apply(&p->accel_up, raw[2], &flags, PLUMB_QUAD_FLAG_ACCEL_Z_CLAMPED);
    const int32_t driving = axis_driving_rate(&p->kalman, w->step == 0U, rate, w->rate_turnps_q28);
    w->step++;
    w->rate_turnps_q28 = rate;
    w->accel_y_g_q26 = accel_y;
    w->accel_z_g_q26 = accel_z;
    w->clamped_steps += flags != 0U;

    const axis_measurement_t measured = axis_measure(&p->tilt, accel_y, accel_z);
    w->variance = measured.variance;
    w->tilt_measured_turn_q32 = measured.tilt_turn_q32;

    const axis_estimate_t now = axis_filter(&w->kalman, &p->kalman, measured, driving, rate);
    const int32_t error = sub_wrap(setpoint_turn_q32, now.tilt_turn_q32);
    w->tilt_turn_q32 = now.tilt_turn_q32;
    w->bias_turnps_q28 = now.bias_turnps_q28;
    w->rate_corrected_turnps_q28 = now.rate_corrected_turnps_q28;
    w->pid.error_turn_q32 = error;

    pid_step(&w->pid, &p->pid, error, now.rate_corrected_turnps_q28);
    pulses(w->pulse_halfus, &p->esc, w->pid.command_q22);
    w->flags = flags | (w->pid.excess_q22 != 0 ? PLUMB_QUAD_FLAG_COMMAND_LIMITED : 0U);
}

SELDOM_CALLED void plumb_quad_retune(plumb_quad_t *c, const plumb_params_t *from, const plumb_params_t *to) {
    plumb_pid_retune(&c->words.pid, &from->pid, &to->pid);
}

SELDOM_CALLED bool plumb_quad_params_valid(const plumb_params_t *p) {
    return plumb_calibration_valid(&p->gyro) && plumb_calibration_valid(&p->accel) &&
           plumb_calibration_valid(&p->accel_up) && plumb_tilt_valid(&p->tilt) &&
           plumb_kalman_valid(&p->kalman, &p->start) && plumb_pid_valid(&p->pid) && plumb_esc_valid(&p->esc);
}

/* An axis on a pivot: vibration and bursts of 0.3 g, no free fall. Armed near level. */
const plumb_plausibility_bounds_t plumb_quad_plausibility = {
    PLUMB_PLAUSIBILITY_PLACES(plumb_quad_words_t, setpoint_turn_q32, accel_y_g_q26, accel_z_g_q26),
    .accel_min_g2_q20 = 377487U,   /* 0.6 g */
    .accel_max_g2_q20 = 2055209U,  /* 1.4 g */
    .rest_min_g2_q20 = 849347U,    /* 0.9 g */
    .rest_max_g2_q20 = 1268777U,   /* 1.1 g */
    .rest_turnps_q28 = 3728270U,   /* 5 deg/s */
    .uneven_turn_q32 = 155096041U, /* 13 deg a step: 0.1 V of noise on every pin gives 4 to 11 at 5 ms, 0.5 V
                                      on one 16 to 38 */
    .ready_turn_q32 = 178956971U,  /* 15 deg */
};
