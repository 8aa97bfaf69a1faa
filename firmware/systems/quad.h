/* One axis of a quadrotor: raw counts in, pulses of two opposing motors out, every intermediate kept.
 *
 *     counts -> calibration -> tilt, trust -> kalman -> pid -> pulses of the two opposing motors
 */
#ifndef PLUMB_SYSTEMS_QUAD_H
#define PLUMB_SYSTEMS_QUAD_H

#include "core/plausibility.h"
#include "generated/records.h"

/* Its state is its record. */
typedef struct {
    quad_words_t words;
} quad_t;

/* All words become zero but those of the filter's and the pid's state. */
void quad_init(quad_t *c, const control_params_t *p);

/* False if any sum of the step could overflow: 64-bit products, no division. */
bool quad_params_valid(const control_params_t *p);

/* One step. raw: gyro (turn/s Q28 by its calibration), acceleration along y and z (g Q26), three unused;
 * setpoint: turn Q32. The result is c->words. */
void quad_step(quad_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
               int32_t setpoint_turn_q32);

/* What its sensors can say, and when it may be armed. */
extern const plausibility_bounds_t quad_plausibility;

#endif
