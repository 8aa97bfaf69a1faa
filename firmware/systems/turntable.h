/* Attitude from a gyro and an angular-acceleration sensor of different rates: raw counts in, quaternion out.
 *
 *     counts -> presence, spikes, noise -> alignment -> lag -> data layer or attitude layer -> quaternion
 *
 * Steps run at the rate of the angular accelerometer (raw[3..5]); gyro samples (raw[0..2]) come in some of
 * them, older than the step by an age that an accumulator of gyro_period keeps. A count of -32768 is no
 * sample. The first rest_steps are at rest: they give both biases, and the attitude stays where it is.
 *
 * Data layer: the rate's difference corrects rate, biases, angle, scale and lag. Attitude layer: each sensor
 * has an attitude of its own, their difference corrects both. The loss of either sensor changes what is
 * predicted from what; nothing stops.
 */
#ifndef PLUMB_SYSTEMS_TURNTABLE_H
#define PLUMB_SYSTEMS_TURNTABLE_H

#include "core/quaternion.h"
#include "generated/records.h"

/* Its state is its record. */
typedef struct {
    turntable_words_t words;
} turntable_t;

/* The words become zero but for attitudes, age, lag, gaps, and the variances of the start. */
void turntable_init(turntable_t *c, const control_params_t *p);

/* False if a word that the step reads is outside its range, or any sum of the step could overflow. */
bool turntable_params_valid(const control_params_t *p);

/* One step. raw: gyro x, y, z (turn/s Q28 by `gyro`), angular acceleration x, y, z (turn/s^2 Q28 by
 * fusion.angular); setpoint: unused. The result is c->words. */
void turntable_step(turntable_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                    int32_t setpoint);

#endif
