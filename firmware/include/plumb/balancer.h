/* Two-wheel self-balancing vehicle: from raw counts to the duty of the motor's bridge, with all intermediate
 * values.
 *
 *     counts -> calibration, wheel -> tilt and its variance -> kalman -> speed loop -> balance loop -> duty
 *
 * While the vehicle balances, the forward accelerometer hardly measures tilt, because the effects of leaning
 * and of accelerating cancel. The acceleration measured by the wheels is therefore subtracted before the
 * arctangent (not with wheel.accel_gain 0, as in the source). The speed loop commands a lean; the balance
 * loop controls it.
 */
#ifndef PLUMB_BALANCER_H
#define PLUMB_BALANCER_H

#include "plumb/design.h"
#include "plumb/plausibility.h"
#include "plumb/records.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of the controller: the record of the last step, and what a system sets that calls its step. */
typedef struct {
    plumb_balancer_words_t words;
    uint32_t blind; /* not 0: the accelerometer is not believed, the tilt measured is the one estimated in the
                       step before; 0 at the start */
} plumb_balancer_t;

/* Clear the record and set the initial state of the filter. */
void plumb_balancer_init(plumb_balancer_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_balancer_params_valid(const plumb_params_t *p);

/* One step. raw: gyro about the axle, acceleration forward and up, count of Hall edges, two unused; setpoint:
 * velocity, m/s Q26. The result is c->words. */
void plumb_balancer_step(plumb_balancer_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint_mps_q26);

/* Other gains from the next step on, without a jump of the command (plumb_pid_retune). */
void plumb_balancer_retune(plumb_balancer_t *c, const plumb_params_t *from, const plumb_params_t *to);

/* Bounds for plausible sensors, and conditions for arming. */
extern const plumb_plausibility_bounds_t plumb_balancer_plausibility;

/* Hall edges to speed and acceleration of the axle. */
typedef struct {
    double edge_m;      /* distance of the axle per edge; the sign sets the direction */
    int32_t edges_max;  /* in one period, 1 to 32767, at most 15 m/s; more are clamped and flagged. 0: as many
                           as 15 m/s are at this period */
    double tau_s;       /* time constant of the filter of the speed, at least 0 */
    double accel_share; /* fraction of the axle's acceleration subtracted from the forward axis; 0: none */
} plumb_wheel_tuning_t;

/* Speed loop: lean setpoint from the velocity error. */
typedef struct {
    double lean_deg_per_mps;
    double lean_deg_per_m; /* integral, at least 0 */
    double lean_deg_per_g; /* damping by the axle's acceleration */
    double accel_tau_s;    /* time constant of the filter of that acceleration, at least 0 */
    double lean_slew_dps;  /* above 0 */
    double speed_max_mps;  /* 0 to 8; setpoints beyond are clamped and flagged */
    double lean_max_deg;   /* above 0, at most 22.5 */
} plumb_speed_tuning_t;

/* Duty of the bridge: span * command, within +-duty_max. */
typedef struct {
    double span;     /* -32767/32768 to 32767/32768; negative if a positive command must drive backwards */
    double duty_max; /* 0 to 32767/32768 */
    double fall_deg; /* 0 to 180: beyond it the duty stays 0 until the run ends */
} plumb_drive_tuning_t;

/* Settings of the balancer. calibration.accel is the forward axis, sin(tilt) at rest. */
typedef struct {
    int32_t period_us; /* of a step: 500 to 100000 */
    plumb_calibration_tuning_t calibration;
    plumb_kalman_tuning_t kalman;
    plumb_trust_tuning_t trust;
    int32_t tilt; /* plumb_tilt_choice_t */
    plumb_start_tuning_t start;
    plumb_pid_tuning_t pid;
    plumb_wheel_tuning_t wheel;
    plumb_speed_tuning_t speed;
    plumb_drive_tuning_t drive;
} plumb_balancer_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_balancer_design(const plumb_balancer_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
