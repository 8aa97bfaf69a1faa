#include "control.h"

#define PULSE_MAX 16383 /* half-microseconds */

/* The words are hashed as bytes: no padding anywhere. */
typedef char control_assert_packed[sizeof(control_words_t) == 160 ? 1 : -1];
typedef char control_assert_words[sizeof(control_params_t) == 184 ? 1 : -1];

void control_init(control_t *c, const control_params_t *p) {
    *c = (control_t){0};
    kalman_init(&c->words.kalman, &p->start);
    pid_init(&c->words.pid);
}

static int32_t calibrate(const calibration_params_t *p, int32_t raw, uint32_t *flags, uint32_t flag) {
    const int32_t used = calibration_clamp(p, raw);
    *flags |= used != raw ? flag : 0U;
    return calibration_scale(p, used);
}

static void pulses(uint32_t pulse_halfus[2], const esc_params_t *p, int32_t command_q22) {
    const int32_t thrust = asr32(asr32(command_q22, 6) * p->span_halfus + (1 << 15), 16);
    pulse_halfus[0] = (uint32_t)clamp_i32(p->mid_halfus + thrust, p->min_halfus, p->max_halfus);
    pulse_halfus[1] = (uint32_t)clamp_i32(p->mid_halfus - thrust, p->min_halfus, p->max_halfus);
}

void control_step(control_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                  int32_t setpoint_turn_q32) {
    control_words_t *w = &c->words;
    for (int i = 0; i < CONTROL_RAW_MAX; i++)
        w->raw[i] = raw[i];
    w->setpoint_turn_q32 = setpoint_turn_q32;
    w->step++;

    const int32_t rate_last = w->rate_turnps_q28;
    uint32_t flags = 0;
    w->rate_turnps_q28 = calibrate(&p->gyro, raw[0], &flags, CONTROL_FLAG_GYRO_CLAMPED);
    w->accel_y_g_q26 = calibrate(&p->accel_y, raw[1], &flags, CONTROL_FLAG_ACCEL_Y_CLAMPED);
    w->accel_z_g_q26 = calibrate(&p->accel_z, raw[2], &flags, CONTROL_FLAG_ACCEL_Z_CLAMPED);
    w->clamped_steps += flags != 0U;

    w->tilt_measured_turn_q32 = tilt_angle(&p->tilt, w->accel_y_g_q26, w->accel_z_g_q26);
    w->variance = tilt_variance(&p->tilt, w->accel_y_g_q26, w->accel_z_g_q26);

    /* the sources drive the filter with the sample before; the first step has none */
    const int32_t rate = p->kalman.rate_now || w->step == 1U ? w->rate_turnps_q28 : rate_last;
    kalman_step(&w->kalman, &p->kalman, w->variance, w->tilt_measured_turn_q32, rate);
    w->tilt_turn_q32 = kalman_tilt(&w->kalman);
    w->bias_turnps_q28 = kalman_bias(&w->kalman, &p->kalman);
    w->rate_corrected_turnps_q28 = sub_wrap(w->rate_turnps_q28, w->bias_turnps_q28);

    w->pid.error_turn_q32 = sub_wrap(setpoint_turn_q32, w->tilt_turn_q32);
    pid_step(&w->pid, &p->pid, w->pid.error_turn_q32, w->rate_corrected_turnps_q28);
    pulses(w->pulse_halfus, &p->esc, w->pid.command_q22);

    flags |= w->pid.excess_q22 != 0 ? CONTROL_FLAG_COMMAND_LIMITED : 0U;
    w->flags = flags;
}

static bool esc_valid(const esc_params_t *p) {
    return p->mid_halfus >= 0 && p->mid_halfus <= PULSE_MAX && p->span_halfus >= -PULSE_MAX &&
           p->span_halfus <= PULSE_MAX && p->min_halfus >= 0 && p->min_halfus <= p->max_halfus &&
           p->max_halfus <= PULSE_MAX && p->neutral_halfus >= 0 && p->neutral_halfus <= PULSE_MAX;
}

bool control_params_valid(const control_params_t *p) {
    return calibration_valid(&p->gyro) && calibration_valid(&p->accel_y) && calibration_valid(&p->accel_z) &&
           tilt_valid(&p->tilt) && kalman_valid(&p->kalman, &p->start) && pid_valid(&p->pid) &&
           esc_valid(&p->esc);
}
