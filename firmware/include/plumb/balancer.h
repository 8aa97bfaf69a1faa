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
#ifndef PLUMB_BALANCER_H
#define PLUMB_BALANCER_H

#include "plumb/design.h"
#include "plumb/plausibility.h"
#include "plumb/records.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Its state is its record. */
typedef struct {
    plumb_balancer_words_t words;
} plumb_balancer_t;

/* All words become zero but those of the filter's start. */
void plumb_balancer_init(plumb_balancer_t *c, const plumb_params_t *p);

/* False if any sum of the step could overflow. */
bool plumb_balancer_params_valid(const plumb_params_t *p);

/* One step. raw: gyro about the axle, acceleration forward and up, count of Hall edges, two unused; setpoint:
 * velocity, m/s Q26. The result is c->words. */
void plumb_balancer_step(plumb_balancer_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint_mps_q26);

/* What its sensors can say, and when it may be armed. */
extern const plumb_plausibility_bounds_t plumb_balancer_plausibility;

/* Hall edges to speed and acceleration of the axle. */
typedef struct {
    double edge_m;      /* way of the axle per edge; the sign turns the direction */
    int32_t edges_max;  /* 1 to 32767 in one period, at most 15 m/s; more are clamped and flagged */
    double tau_s;       /* filter of the speed, at least 0 */
    double accel_share; /* how much of the axle's acceleration is taken off the forward axis; 0: none */
} plumb_wheel_tuning_t;

/* The lean that a velocity error asks for. */
typedef struct {
    double lean_deg_per_mps;
    double lean_deg_per_m; /* integral, at least 0 */
    double lean_deg_per_g; /* against the axle's acceleration */
    double accel_tau_s;    /* filter of that acceleration, at least 0 */
    double lean_max_deg;   /* above 0, at most 22.5 */
    double lean_slew_dps;  /* above 0 */
    double speed_max_mps;  /* 0 to 8; setpoints beyond are clamped and flagged */
} plumb_speed_tuning_t;

/* Duty of the bridge: span * command, within +-duty_max. */
typedef struct {
    double span; /* -32767/32768 to 32767/32768; negative when a positive command has to drive backwards */
    double duty_max; /* 0 to 32767/32768 */
    double fall_deg; /* 0 to 180: beyond it the duty stays 0 until the run ends */
} plumb_drive_tuning_t;

/* balancer: a vehicle on two wheels. calibration.accel is the forward axis, sin(tilt) at rest. */
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

/* The integers of a tuning; a refusal leaves *params as it was (plumb/design.h). */
plumb_design_t plumb_balancer_design(const plumb_balancer_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
