/* Pitch and roll of a phone: two two-state filters, each on the Euler rate of its axis or, as the source
 * prints it, on the body's rate.
 *
 *     counts -> calibration -> rates of pitch and roll, pitch and roll of the acceleration -> two filters
 *
 * raw: gyro x, y, z, acceleration x, y, z, in the axes of Android. At rest the acceleration is
 * g (-sin(pitch), cos(pitch) sin(roll), cos(pitch) cos(roll)). All three rates share the calibration `gyro`,
 * all three accelerations `accel_y`: whoever sends them has calibrated the axes. Pitch uses the groups tilt,
 * kalman and start, roll its own; tilt.r_base and roll.r_base are constant, r_max stands in for a measurement
 * that is left out. Nothing is controlled and no pin moves.
 */
#ifndef PLUMB_CORE_PHONE_H
#define PLUMB_CORE_PHONE_H

#include "control_params.h"

#define PHONE_FLAG_GYRO_CLAMPED      (1U << 0) /* a rate, of the phone or of an angle */
#define PHONE_FLAG_ACCEL_CLAMPED     (1U << 1)
#define PHONE_FLAG_ROLL_UNCORRECTED  (1U << 2) /* x is too near the vertical to tell roll */
#define PHONE_FLAG_PITCH_UNCORRECTED (1U << 3) /* no acceleration to speak of: falling */
#define PHONE_FLAGS_SATURATED        (PHONE_FLAG_GYRO_CLAMPED | PHONE_FLAG_ACCEL_CLAMPED)

typedef struct {
    int32_t raw[CONTROL_RAW_MAX]; /* counts, as given */
    int32_t setpoint_turn_q32;    /* as given; not used */
    int32_t rate_x_turnps_q28, rate_y_turnps_q28, rate_z_turnps_q28;
    int32_t accel_x_g_q26, accel_y_g_q26, accel_z_g_q26;
    int32_t tangent_q26; /* of the pitch before this step, within +-16; 0 with body rates */
    int32_t pitch_rate_turnps_q28, roll_rate_turnps_q28; /* what drives the filters */
    int32_t pitch_measured_turn_q32, roll_measured_turn_q32;
    uint32_t pitch_variance, roll_variance; /* R of this step, each in 2^32 lsb of its filter */
    kalman_t pitch, roll;
    int32_t pitch_turn_q32, pitch_bias_turnps_q28, pitch_rate_corrected_turnps_q28;
    int32_t roll_turn_q32, roll_bias_turnps_q28, roll_rate_corrected_turnps_q28;
    uint32_t uncorrected_steps; /* so far, steps in which either axis was not corrected */
    uint32_t clamped_steps;     /* so far, steps with a count or a rate outside its range */
    uint32_t flags;             /* PHONE_FLAG_* of this step */
    uint32_t step;              /* number of this step in the run, from 1 */
} phone_words_t;

typedef struct {
    phone_words_t words;
} phone_t;

void phone_init(phone_t *c, const control_params_t *p);

bool phone_params_valid(const control_params_t *p);

/* One step; the result is c->words. */
void phone_step(phone_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                int32_t setpoint_turn_q32);

#endif
