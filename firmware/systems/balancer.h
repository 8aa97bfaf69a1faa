/* A vehicle on two wheels that balances: raw counts in, duty of the motor's bridge out, every intermediate
 * kept.
 *
 *     counts -> calibration, wheel -> tilt, trust -> kalman -> speed loop -> balance loop -> duty of the
 * bridge
 *
 * While it balances, the accelerometer along the body hardly sees tilt: leaning and accelerating cancel. What
 * the wheels say of the acceleration is therefore taken off before the arctangent (wheel.accel_gain 0: not,
 * as the source has it). The speed loop asks for a lean, the balance loop leans.
 */
#ifndef PLUMB_SYSTEMS_BALANCER_H
#define PLUMB_SYSTEMS_BALANCER_H

#include "core/plausibility.h"
#include "generated/records.h"

/* Its state is its record. */
typedef struct {
    balancer_words_t words;
} balancer_t;

/* All words become zero but those of the filter's start. */
void balancer_init(balancer_t *c, const control_params_t *p);

/* False if any sum of the step could overflow. */
bool balancer_params_valid(const control_params_t *p);

/* One step. raw: gyro about the axle, acceleration forward and up, count of Hall edges, two unused; setpoint:
 * velocity, m/s Q26. The result is c->words. */
void balancer_step(balancer_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                   int32_t setpoint_mps_q26);

/* What its sensors can say, and when it may be armed. */
extern const plausibility_bounds_t balancer_plausibility;

#endif
