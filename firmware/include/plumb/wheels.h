/* A two-wheeled vehicle that steers: from raw counts, speed and turn rate to the duties of two motors.
 *
 *     counts -> balancer on the sum of both wheels -> its duty -+-> mixer -> duties left and right
 *     gyro z, difference of the wheels -> turn rate -> rate loop -+
 *
 * The step calls that of plumb/balancer.h: both wheels together are its one wheel. Turning is a second loop.
 * The mixer serves balance first: turning gets what balance leaves of the duty.
 *
 * Whatever decides an output is computed in the step from recorded inputs: whether somebody rides, how old
 * the receiver's frames are, and what happens without them. The sources and figures are in
 * docs/systems/wheels.md, every word in docs/reference/arithmetic/wheels.md.
 *
 * raw: gyro about the axle, acceleration forward and up, gyro up, counts of the left and the right encoder,
 * the rider's switch, two unused; then the commands roll, pitch, yaw, switches, receiver; setpoint: speed,
 * share of the most, Q15. */
#ifndef PLUMB_WHEELS_H
#define PLUMB_WHEELS_H

#include "plumb/balancer.h"
#include "plumb/plausibility.h"
#include "plumb/rate_loop.h"
#include "plumb/records.h"
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_WHEELS_NUMBER_MASK 255 /* of the command `receiver`: number of its newest frame */
#define PLUMB_WHEELS_FAILSAFE    256 /* and: it says that it has lost the transmitter */

#define PLUMB_WHEELS_MOTORS_ON 1U /* of the command `switches` */

/* Word `phase`. */
#define PLUMB_WHEELS_STOPPED                                                                                 \
    0U /* both duties 0, both controllers at rest: nobody rides; at the start, too                           \
        */
#define PLUMB_WHEELS_RIDDEN   1U
#define PLUMB_WHEELS_STOPPING 2U /* the rider has left: comes to rest, balanced */

/* Word `stop_reason`: in PLAUSIBILITY.failed these bits are 8 higher. */
#define PLUMB_WHEELS_STOP_FALLEN 32U /* kept until the run ends */
#define PLUMB_WHEELS_STOP_RIDER  64U /* phase is PLUMB_WHEELS_STOPPED */
#define PLUMB_WHEELS_STOP_SENSORS                                                                            \
    128U /* the accelerometer stood still; or, until it is switched off, encoders without counts, or wheels  \
            in the air */

/* The record of the last step, then the state of balancer, whose own words are in no digest of this system
 * but where the step copies them. */
typedef struct {
    plumb_wheels_words_t words;
    plumb_balancer_t balancer;
} plumb_wheels_t;

/* Clear the record and set the initial state of the filter. */
void plumb_wheels_init(plumb_wheels_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_wheels_params_valid(const plumb_params_t *p);

/* One step. The result is c->words. */
void plumb_wheels_step(plumb_wheels_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                       int32_t setpoint_speed_q15);

/* Other gains from the next step on, without a jump of the command (plumb_pid_retune). */
void plumb_wheels_retune(plumb_wheels_t *c, const plumb_params_t *from, const plumb_params_t *to);

/* Bounds for plausible sensors, and conditions for arming. */
extern const plumb_plausibility_bounds_t plumb_wheels_plausibility;

#ifdef __cplusplus
}
#endif

#endif
