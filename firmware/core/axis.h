/* One axis: the pipeline of every system that estimates tilt, once for each of its axes.
 *
 *     counts -> calibration_apply -> axis_driving_rate \
 *                                 -> axis_measure       -> axis_filter -> tilt, bias, corrected rate
 *
 * Each function is inlined into the step that calls it (KERNEL). The step owns its record: it passes values
 * in and stores the results in the words of its record.
 */
#ifndef PLUMB_CORE_AXIS_H
#define PLUMB_CORE_AXIS_H

#include "calibration.h"
#include "kalman.h"
#include "tilt.h"

/* Tilt measured by the accelerometer in one step. */
typedef struct {
    int32_t tilt_turn_q32;
    uint32_t variance; /* R, in 2^32 lsb of the filter; 1..PLUMB_KALMAN_R_MAX */
} axis_measurement_t;

/* Estimate of the axis after a step. */
typedef struct {
    int32_t tilt_turn_q32;
    int32_t bias_turnps_q28;           /* of the gyro, within the limit bias_max */
    int32_t rate_corrected_turnps_q28; /* rate - bias */
} axis_estimate_t;

/* Copies the six raw counts into the first words of a record: all loads, then all stores, which takes fewer
 * cycles on the Cortex-M3. */
KERNEL void axis_record_raw(int32_t words[6], const int16_t raw[6]) {
    const int32_t raw0 = raw[0], raw1 = raw[1], raw2 = raw[2], raw3 = raw[3], raw4 = raw[4], raw5 = raw[5];
    words[0] = raw0;
    words[1] = raw1;
    words[2] = raw2;
    words[3] = raw3;
    words[4] = raw4;
    words[5] = raw5;
}

/* Gyro rate that predicts the tilt (parameter rate_now): 0 the previous sample's, as the sources print it, 1
 * the present one's, 2 the mean of both, by the trapezium. The first step has no previous sample and uses the
 * present one. */
KERNEL int32_t axis_driving_rate(const plumb_kalman_params_t *p, bool first, int32_t present,
                                 int32_t before) {
    const int32_t from = p->rate_now == 1U || first ? present : before;
    const int32_t to = p->rate_now != 0U ? present : from;
    return mean_floor(from, to);
}

/* Measured tilt and its variance, from accelerations (g Q26) within +-PLUMB_CALIBRATION_LIMIT. */
KERNEL axis_measurement_t axis_measure(const plumb_tilt_params_t *p, int32_t accel_y_g_q26,
                                       int32_t accel_z_g_q26) {
    axis_measurement_t m;
    m.variance = tilt_variance(p, accel_y_g_q26, accel_z_g_q26);
    m.tilt_turn_q32 = tilt_angle(p, accel_y_g_q26, accel_z_g_q26);
    return m;
}

/* One step of the filter. driving: the rate that predicts the tilt; rate: the present rate, published after
 * subtraction of the bias. */
KERNEL axis_estimate_t axis_filter(plumb_kalman_t *k, const plumb_kalman_params_t *p, axis_measurement_t m,
                                   int32_t driving_turnps_q28, int32_t rate_turnps_q28) {
    axis_estimate_t e;
    kalman_step(k, p, m.variance, m.tilt_turn_q32, driving_turnps_q28);
    e.tilt_turn_q32 = kalman_tilt(k);
    e.bias_turnps_q28 = kalman_bias(k, p);
    e.rate_corrected_turnps_q28 = sub_wrap(rate_turnps_q28, e.bias_turnps_q28);
    return e;
}

#endif
