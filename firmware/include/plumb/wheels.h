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

/* The turn rate: how it is measured, asked for and controlled. Gains are at least 0; a command of 1 is the
 * full duty. */
typedef struct {
    double count_m;        /* way of a wheel per count of its encoder */
    double track_m;        /* between the wheels, not 0; the sign turns the direction */
    double wheels_max_dps; /* that the wheels may show, at least a count in a step: to 1440 */
    double bias_tau_s;     /* with which the gyro's bias follows the wheels, at least 1.45 periods */
    double doubt_dps;      /* disagreement of gyro and wheels that counts for the bias: 0 to 360 */
    double slip_dps;       /* disagreement that shows a slipping wheel: 0 to 1440 */
    double slip_s;         /* for which it then counts as slipping: 0 to 65535 steps */
    double rate_max_dps;   /* that a full stick asks for: 0 to 1440 */
    double integral_max;   /* 0 to 1 */
    double duty_max;       /* 0 to below 1 */
    double slip_mps;       /* change of the speed asked for while a wheel slips: 0 to 8 */
    double kp_per_dps;
    double ki_per_deg;
    double kd_per_dps2;
    double ff_per_dps; /* of the rate that is asked for */
} plumb_wheels_turning_tuning_t;

/* The rider's switch, and the receiver. Times are 1 to 65535 steps; stopping_s may be 0. */
typedef struct {
    double lost_s;     /* without a new frame: the receiver is lost */
    double absent_s;   /* without the rider: the vehicle comes to rest */
    double stopping_s; /* its motors then stop */
    double up_deg;     /* largest tilt at which it takes a rider again: 0 to 180 */
} plumb_wheels_riding_tuning_t;

/* When encoders and accelerometer are not believed, and wheels count as lifted. Times are 1 to 65535 steps.
 */
typedef struct {
    double apart_tau_s; /* with which the speed felt follows the wheels, at least 1.45 periods */
    double apart_mps;   /* speed felt beyond which wheels that never counted are not believed: 0 to 16 */
    double dead_s;      /* without a count: an encoder may be dead; from 2 steps */
    double rocked_deg;  /* by which the body rocks in that time if it is: 0 to 1440 deg/s in one step */
    double full_s;      /* at 7/8 of the full duty: the wheels turn in the air */
    double still_s;     /* with a repeated count of the accelerometer: it is not believed */
} plumb_wheels_watching_tuning_t;

/* Settings of the vehicle. A refused setting of balance is named without "balance.". */
typedef struct {
    int32_t period_us;               /* of a step: 500 to 100000; a board takes 1000 or more */
    plumb_balancer_tuning_t balance; /* its edges are counts of both encoders; its period is not used */
    plumb_wheels_turning_tuning_t turning;
    plumb_wheels_riding_tuning_t riding;
    plumb_wheels_watching_tuning_t watching;
} plumb_wheels_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_wheels_design(const plumb_wheels_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
