/* A quadrotor in the air: attitude with the drag of its rotors, a cascade of vertical and rates, four rotors.
 *
 *     counts -> attitude -> vertical, rates -> lean error -> asked rates -> three rate loops -> mixer ->
 * pulses
 *
 * Mode level: the sticks ask for a lean; the cross product of the wanted and the estimated vertical is the
 * error, no angle is computed, and every attitude rights itself. Mode rate: they ask for rates. The mixer of
 * an X frame serves roll and pitch first, then yaw, then the throttle.
 *
 * Whatever decides an output is computed in the step from recorded inputs: whether the vehicle flies, how old
 * the receiver's frames are, and what happens without them. The sources and figures are in
 * docs/systems/quadrotor.md, every word in docs/reference/arithmetic/quadrotor.md.
 *
 * raw: gyro x, y, z, acceleration x, y, z (as plumb/attitude.h), then the commands roll, pitch, yaw,
 * switches, receiver; setpoint: throttle, Q15. Axes of the body: x to the front, y to the left, z up.
 *
 * The pin set quadrotor drives the four pulses while the board is armed; plumb_quadrotor_takeoff says when it
 * may be. */
#ifndef PLUMB_QUADROTOR_H
#define PLUMB_QUADROTOR_H

#include "plumb/attitude.h"
#include "plumb/records.h"
#include "plumb/takeoff.h"
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_QUADROTOR_ROTORS_ON   1 /* bits of the command `switches` */
#define PLUMB_QUADROTOR_MODE_RATE   2
#define PLUMB_QUADROTOR_NUMBER_MASK 255 /* of the command `receiver`: number of its newest frame */
#define PLUMB_QUADROTOR_FAILSAFE    256 /* and: it says that it has lost the transmitter */

/* Word `phase`. */
#define PLUMB_QUADROTOR_FLOWN   0U
#define PLUMB_QUADROTOR_HELD    1U /* receiver lost: level, throttle as it was, at most that of a hover */
#define PLUMB_QUADROTOR_LANDING 2U /* level, descent at a given speed */
#define PLUMB_QUADROTOR_STOPPED 3U /* until the rotors are switched off; at the start, too */

/* Word `stop_reason`. */
#define PLUMB_QUADROTOR_STOPPED_BLIND    1U /* no samples */
#define PLUMB_QUADROTOR_STOPPED_LYING    2U /* on its side or back */
#define PLUMB_QUADROTOR_STOPPED_IDLE     4U /* on the ground with the throttle low */
#define PLUMB_QUADROTOR_STOPPED_RECEIVER 8U /* receiver lost */
#define PLUMB_QUADROTOR_STOPPED_UNSURE                                                                       \
    16U /* on the ground, and the estimator does not know the vertical yet */
#define PLUMB_QUADROTOR_STOPPED_RUNAWAY  32U /* at the take-off a rate grew against its limited command */
#define PLUMB_QUADROTOR_STOPPED_UPTURNED 64U /* upside down for seconds although level was asked for */

/* The record of the last step, then the estimator's state, whose own words are in no digest of this system.
 */
typedef struct {
    plumb_quadrotor_words_t words;
    plumb_attitude_t attitude;
} plumb_quadrotor_t;

/* When it may be armed. */
extern const plumb_takeoff_bounds_t plumb_quadrotor_takeoff;

/* The record is zero but for the phase, which is stopped, and the attitude of the start; the first sample
 * aligns it. */
void plumb_quadrotor_init(plumb_quadrotor_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_quadrotor_params_valid(const plumb_params_t *p);

/* One step. The result is c->words. */
void plumb_quadrotor_step(plumb_quadrotor_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                          int32_t setpoint);

/* The loop of one axis: commands by rates, a command of 1 is all that the rotors have. Gains are at least 0.
 */
typedef struct {
    double kp_per_dps;
    double ki_per_deg;
    double kd_per_dps2;
    double ff_per_dps; /* of the rate that is asked for */
} plumb_quadrotor_gains_tuning_t;

/* The loops of the three rates, and what full sticks ask for. */
typedef struct {
    plumb_quadrotor_gains_tuning_t roll, pitch, yaw;
    double roll_pitch_max_dps; /* mode rate: 0 to 1800 */
    double yaw_max_dps;        /* 0 to 990 */
    double d_tau_s;            /* low-pass of the rate in the D term; 0: none */
    double integral_max;       /* 0 to 1 */
} plumb_quadrotor_rates_tuning_t;

/* Mode level: the sticks ask for a lean. */
typedef struct {
    double lean_max_deg;        /* 0 to 36.8 */
    double gain_per_s;          /* rate by the sine of the error of the vertical */
    double rate_max_dps;        /* 0 to 1800 */
    double unsure_rate_max_dps; /* the same while the estimator is unsure of the vertical */
} plumb_quadrotor_level_tuning_t;

/* How four rotors share the commands. */
typedef struct {
    double yaw_max;  /* largest command of yaw: 0 to 1 */
    double idle;     /* least command of a rotor that is on: 0 to 1/4 */
    int32_t airmode; /* 1: in the air roll and pitch may raise the thrust over the throttle; 0: never */
    double low;      /* throttle below which the stick is low: 0 to 1/4 */
} plumb_quadrotor_mixer_tuning_t;

/* What happens without the receiver. Times are 1 to 65535 steps; held_s may be 0. */
typedef struct {
    double lost_s;
    double held_s;
    double back_s;
    int32_t lands;   /* 0: then the rotors stop; 1: the vehicle lands */
    double land_mps; /* 0 to 4.9 */
    double land_s;
} plumb_quadrotor_receiver_tuning_t;

/* What stops the rotors until they are switched off: times, 1 to 65535 steps. */
typedef struct {
    double blind_s;
    double idle_s;
    double lying_s;
    double runaway_s;
    double upturned_s;
} plumb_quadrotor_stops_tuning_t;

/* Settings of the quadrotor. A refused setting of attitude is named without "attitude.". */
typedef struct {
    int32_t period_us;                /* of a step: 1000 to 21000 */
    plumb_attitude_tuning_t attitude; /* its own period is not used */
    plumb_quadrotor_rates_tuning_t rates;
    plumb_quadrotor_level_tuning_t level;
    plumb_quadrotor_mixer_tuning_t mixer;
    plumb_quadrotor_receiver_tuning_t receiver;
    plumb_quadrotor_stops_tuning_t stops;
    plumb_esc_tuning_t esc; /* mid_us at command 0, mid_us + span_us at 1 */
} plumb_quadrotor_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_quadrotor_design(const plumb_quadrotor_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
