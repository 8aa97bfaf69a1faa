/* The kernels that the core inlines, as functions of the library. */
#include "core/angle.h"
#include "core/calibration.h"
#include "core/kalman.h"
#include "core/pid.h"
#include "core/tilt.h"
#include "core/wheel.h"

int32_t plumb_angle_atan2(int32_t y, int32_t x) {
    return angle_atan2(y, x);
}

int32_t plumb_angle_asin(int32_t x_q30) {
    return angle_asin(x_q30);
}

int32_t plumb_calibration_apply(const plumb_calibration_params_t *p, int32_t raw, bool *clamped) {
    uint32_t flags = 0;
    const int32_t value = calibration_apply(p, raw, &flags, 1U);
    if (flags != 0U) {
        *clamped = true;
    }
    return value;
}

int32_t plumb_tilt_angle(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26) {
    return tilt_angle(p, accel_y_g_q26, accel_z_g_q26);
}

uint32_t plumb_tilt_variance(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26) {
    return tilt_variance(p, accel_y_g_q26, accel_z_g_q26);
}

void plumb_kalman_step(plumb_kalman_t *k, const plumb_kalman_params_t *p, uint32_t r, int32_t tilt_turn_q32,
                       int32_t rate_turnps_q28) {
    kalman_step(k, p, r, tilt_turn_q32, rate_turnps_q28);
}

int32_t plumb_kalman_tilt(const plumb_kalman_t *k) {
    return kalman_tilt(k);
}

int32_t plumb_kalman_bias(const plumb_kalman_t *k, const plumb_kalman_params_t *p) {
    return kalman_bias(k, p);
}

int32_t plumb_kalman_predicted(const plumb_kalman_t *k, const plumb_kalman_params_t *p,
                               int32_t rate_turnps_q28) {
    return kalman_predicted(k, p, rate_turnps_q28);
}

void plumb_pid_step(plumb_pid_t *c, const plumb_pid_params_t *p, int32_t error_turn_q32,
                    int32_t rate_turnps_q28) {
    pid_step(c, p, error_turn_q32, rate_turnps_q28);
}

bool plumb_wheel_step(plumb_wheel_t *c, const plumb_wheel_params_t *p, int32_t edges) {
    return wheel_step(c, p, edges);
}
