/* Pitch and roll of a phone: two two-state filters, each on the Euler rate of its axis or, as the source
 * prints it, on the body's rate.
 *
 *     counts -> calibration -> rates of pitch and roll, pitch and roll of the acceleration -> two filters
 *
 * raw: gyro x, y, z, acceleration x, y, z, in the axes of Android. At rest the acceleration is
 * g (-sin(pitch), cos(pitch) sin(roll), cos(pitch) cos(roll)). All three rates share the calibration `gyro`,
 * all three accelerations `accel`: whoever sends them has calibrated the axes. Pitch uses the groups tilt,
 * kalman and start, roll its own; tilt.r_base and roll.r_base are constant, r_max stands in for a measurement
 * that is left out. Nothing is controlled and no pin moves.
 */
#ifndef PLUMB_SYSTEMS_PHONE_H
#define PLUMB_SYSTEMS_PHONE_H

#include "generated/records.h"

#define PHONE_BODY_RATES  0U /* phone.rates: pitch' = wy, roll' = wx: the source */
#define PHONE_EULER_RATES 1U

typedef struct {
    phone_words_t words;
} phone_t;

void phone_init(phone_t *c, const control_params_t *p);

bool phone_params_valid(const control_params_t *p);

/* One step; the result is c->words. */
void phone_step(phone_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                int32_t setpoint_turn_q32);

#endif
