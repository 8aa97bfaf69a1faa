/* Design: settings in engineering units -> the integers that a step runs on.
 *
 * For a PC, or once at the start on a chip: IEEE doubles, only + - * /, no libm, no allocation. Every integer
 * is within 0.1 % of what was asked, or the setting is refused and named. A refused design leaves *params as
 * it was. The groups of *params that the system does not read are 0.
 *
 * Units are in the names: deg, deg/s (dps), g, m, s, us. A setting is finite. The same settings, ranges and
 * refusals as the host's tunings in Python (host/plumb/systems/NAME/tuning.py, quantise.py). */
#ifndef PLUMB_DESIGN_H
#define PLUMB_DESIGN_H

#include "generated/control_params.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Why a setting is refused. */
typedef enum {
    PLUMB_DESIGN_OK = 0,
    PLUMB_DESIGN_NOT_FINITE,   /* infinite, or not a number */
    PLUMB_DESIGN_NO_CHOICE,    /* an enumeration has no such value */
    PLUMB_DESIGN_NEGATIVE,     /* it cannot be below 0 */
    PLUMB_DESIGN_OUT_OF_RANGE, /* outside the range that its comment gives */
    PLUMB_DESIGN_CONTRADICTS,  /* another setting does not allow it */
    PLUMB_DESIGN_TOO_LARGE,    /* for its integer */
    PLUMB_DESIGN_TOO_SMALL,    /* for its integer */
    PLUMB_DESIGN_TOO_FINE      /* its integer would be more than 0.1 % beside it */
} plumb_design_error_t;

/* What a design gives. */
typedef struct {
    plumb_design_error_t error;
    const char *field; /* the setting that is refused, as "kalman.q_bias_dps2_per_s"; NULL when all is well. A
                          constant */
    double asked;      /* its value */
    double lsb_deg2;   /* unit of variance of the filter, deg^2 per lsb; 0 for a system without one */
} plumb_design_t;

/* One sensor channel: value = (clamp(raw, min_counts, max_counts) - zero_counts) * unit_per_count, within +-7
 * turn/s (2520 deg/s), +-7 turn/s^2 or +-28 g. */
typedef struct {
    double zero_counts;
    double unit_per_count; /* deg/s, deg/s^2 or g; the sign turns the axis */
    int32_t min_counts;    /* -32768 to max_counts: plausible counts, others are clamped and flagged */
    int32_t max_counts;    /* up to 32767 */
} plumb_channel_tuning_t;

/* The channels of one axis. */
typedef struct {
    plumb_channel_tuning_t gyro;     /* deg/s */
    plumb_channel_tuning_t accel;    /* g: horizontal at tilt 0, sin(tilt) at rest */
    plumb_channel_tuning_t accel_up; /* g: cos(tilt) at rest */
} plumb_calibration_tuning_t;

/* Tilt out of accelerations. */
typedef enum {
    PLUMB_TUNING_ARCSINE = 0, /* asin(accel / 1 g), +-90 deg */
    PLUMB_TUNING_ATAN2 = 1    /* atan2(accel, accel_up), +-180 deg */
} plumb_tilt_choice_t;

/* Which gyro sample moves the filter. */
typedef enum {
    PLUMB_TUNING_RATE_PREVIOUS = 0, /* that of the step before, as the papers print it */
    PLUMB_TUNING_RATE_CURRENT = 1
} plumb_rate_choice_t;

/* The two-state filter of tilt and gyro bias. Process noise as densities: Q of a step is the density times
 * the period. */
typedef struct {
    double q_angle_deg2_per_s; /* at least 0 */
    double q_bias_dps2_per_s;  /* (deg/s)^2 per s, at least 0 */
    int32_t rate;              /* plumb_rate_choice_t */
    double bias_max_dps;       /* limit of the published bias: 0 to below 360 */
} plumb_kalman_tuning_t;

/* Measurement variance from the length of the acceleration: R = min(r_deg2 + gain_deg2 (|a|^2 - 1 g^2)^2,
 * r_max_deg2).
 */
typedef struct {
    double r_deg2;     /* above 0 */
    double gain_deg2;  /* deg^2 per g^4, at least 0; 0 keeps R constant, then r_max_deg2 is not used */
    double r_max_deg2; /* at least r_deg2 */
} plumb_trust_tuning_t;

/* State and covariance before the first sample. */
typedef struct {
    double tilt_deg;       /* -180 to 180 */
    double bias_dps;       /* within the filter's bias_max_dps */
    double p00_deg2;       /* at least 0 */
    double p01_deg2_per_s; /* its square at most p00 p11; from -p00 / period to the least of q_angle / 4 and
                              p00 / period */
    double p11_dps2;       /* (deg/s)^2, at least 0 */
} plumb_start_tuning_t;

/* Command in -1 to 1 from the error in deg; D acts on the measured rate behind a first-order filter. */
typedef struct {
    double kp_per_deg;
    double ki_per_deg_s; /* at least 0 */
    double kd_per_dps;
    double derivative_tau_s; /* time constant of the filter, 0: none */
    double slew_per_s;       /* largest change of the command, above 0 */
} plumb_pid_tuning_t;

/* Pulses of two opposing motors: mid +- span * command, within min to max; neutral while disarmed. 900 to
 * 2100 us, neutral <= min <= mid <= max, neutral at most 1100 us. */
typedef struct {
    double mid_us;
    double span_us; /* -1200 to 1200; the sign turns the direction */
    double min_us;
    double max_us;
    double neutral_us;
} plumb_esc_tuning_t;

/* quad: one axis of a quadrotor. */
typedef struct {
    int32_t period_us; /* of a step: 500 to 100000 */
    plumb_calibration_tuning_t calibration;
    plumb_kalman_tuning_t kalman;
    plumb_trust_tuning_t trust;
    int32_t tilt; /* plumb_tilt_choice_t */
    plumb_start_tuning_t start;
    plumb_pid_tuning_t pid;
    plumb_esc_tuning_t esc;
} plumb_quad_tuning_t;

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

/* What drives the filters of phone. */
typedef enum {
    PLUMB_TUNING_RATES_BODY = 0, /* the body's rates, as the source prints it */
    PLUMB_TUNING_RATES_EULER = 1 /* the rates of the angles */
} plumb_rates_choice_t;

/* The filter of one angle. */
typedef struct {
    double q_angle_deg2_per_s; /* at least 0 */
    double q_bias_dps2_per_s;  /* at least 0 */
    double r_deg2;             /* above 0 */
    plumb_start_tuning_t start;
} plumb_phone_axis_tuning_t;

/* phone: pitch and roll. gyro and accel: the channel of all three axes each. */
typedef struct {
    int32_t period_us;            /* of a step: 500 to 100000 */
    plumb_channel_tuning_t gyro;  /* deg/s */
    plumb_channel_tuning_t accel; /* g */
    plumb_phone_axis_tuning_t pitch;
    plumb_phone_axis_tuning_t roll;
    int32_t rates;          /* plumb_rates_choice_t */
    double r_left_out_deg2; /* stands in for R where an acceleration tells no angle; at least both r_deg2 */
    int32_t rate;           /* plumb_rate_choice_t */
    double bias_max_dps;    /* 0 to below 360 */
} plumb_phone_tuning_t;

/* Before fusion, per sensor. */
typedef struct {
    double
        spike; /* deg/s or deg/s^2: further from the line through the last two samples is a spike; above 0 */
    double smooth; /* share of a new sample in a one-pole low-pass: above 0, up to 1 for none */
} plumb_prefilter_tuning_t;

/* What the turntable's fusion compares. */
typedef enum {
    PLUMB_TUNING_LAYER_DATA = 0,     /* rates, with the angle a state */
    PLUMB_TUNING_LAYER_ATTITUDE = 1, /* two attitudes */
    PLUMB_TUNING_LAYER_PRINTED = 2   /* rates; the corrected rate alone turns the quaternion */
} plumb_layer_choice_t;

/* Fusion of gyro and angular accelerometer. Noise as densities; standard deviations at the start. All at
 * least 0. */
typedef struct {
    int32_t layer;            /* plumb_layer_choice_t */
    double gyro_period_s;     /* 1 to 16 steps; taken as the nearest fraction with a denominator up to 10^7 */
    double gyro_phase_s;      /* a sampling instant of the gyro, counted from the first step; up to 10^9 */
    double rest_s;            /* the run begins at rest */
    double lag_s;             /* of the gyro, up to 16 steps */
    double gyro_dps;          /* noise, deg/s per root Hz */
    double angular_dps2;      /* noise, deg/s^2 per root Hz */
    double lost_dps2;         /* what stands for it while the angular accelerometer is lost */
    double gyro_walk_dps;     /* deg/s per root s */
    double angular_walk_dps2; /* deg/s^2 per root s */
    double start_gyro_dps;    /* of the gyro's bias */
    double start_angular_dps2; /* of the other one's */
    double gyro_scale;         /* scale error of the gyro; 0 with angular_scale: not estimated */
    double angular_scale;
    double start_lag_s; /* of the lag, up to one step; 0: not estimated */
} plumb_fusion_tuning_t;

/* turntable: attitude from a gyro and an angular accelerometer. */
typedef struct {
    int32_t period_us;           /* of a step, which is a sample of the angular accelerometer: 500 to 10000 */
    plumb_channel_tuning_t gyro; /* deg/s */
    plumb_channel_tuning_t angular; /* deg/s^2 */
    plumb_prefilter_tuning_t gyro_filter;
    plumb_prefilter_tuning_t angular_filter;
    plumb_fusion_tuning_t fusion;
} plumb_turntable_tuning_t;

plumb_design_t plumb_quad_design(const plumb_quad_tuning_t *tuning, control_params_t *params);
plumb_design_t plumb_balancer_design(const plumb_balancer_tuning_t *tuning, control_params_t *params);
plumb_design_t plumb_phone_design(const plumb_phone_tuning_t *tuning, control_params_t *params);
plumb_design_t plumb_turntable_design(const plumb_turntable_tuning_t *tuning, control_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
