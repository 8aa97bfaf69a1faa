/* Design: convert settings in engineering units to the integer parameters of a step.
 *
 * Meant for a PC, or for the start of a program on a chip: IEEE doubles, only + - * /, no libm, no
 * allocation. Every integer is within 0.1 % of its setting; otherwise the design is refused, names the
 * setting, and leaves *params unchanged. Groups of *params that the system does not read become 0. The header
 * of a system declares its own settings and its design function.
 *
 * Units are in the names: deg, deg/s (dps), g, m, s, us. Settings must be finite. Settings, ranges and
 * refusals are those of the tunings in Python (host/plumb/systems/NAME/tuning.py, quantise.py). */
#ifndef PLUMB_DESIGN_H
#define PLUMB_DESIGN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Why a setting is refused. */
typedef enum {
    PLUMB_DESIGN_OK = 0,
    PLUMB_DESIGN_NOT_FINITE,   /* infinite, or not a number */
    PLUMB_DESIGN_NO_CHOICE,    /* an enumeration has no such value */
    PLUMB_DESIGN_NEGATIVE,     /* below 0 */
    PLUMB_DESIGN_OUT_OF_RANGE, /* outside the range that its comment gives */
    PLUMB_DESIGN_CONTRADICTS,  /* another setting does not allow it */
    PLUMB_DESIGN_TOO_LARGE,    /* for its integer */
    PLUMB_DESIGN_TOO_SMALL,    /* for its integer */
    PLUMB_DESIGN_TOO_FINE      /* its integer would be more than 0.1 % off */
} plumb_design_error_t;

/* Result of a design. */
typedef struct {
    plumb_design_error_t error;
    const char *field;  /* the refused setting, for example "kalman.q_bias_dps2_per_s"; NULL if none. A string
                           constant */
    double asked;       /* value of the refused setting */
    double least, most; /* the limit that refused it, while the others stay; -DBL_MAX, DBL_MAX: none. "Above
                           0" has the least 0. Both 0 if nothing is refused */
    double lsb_deg2;    /* unit of variance of the filter, deg^2 per lsb; 0 for a system without one */
} plumb_design_t;

/* One sensor channel: value = (clamp(raw, min_counts, max_counts) - zero_counts) * unit_per_count, within +-7
 * turn/s (2520 deg/s), +-7 turn/s^2 or +-28 g. */
typedef struct {
    double zero_counts;
    double unit_per_count; /* deg/s, deg/s^2 or g; the sign reverses the axis */
    int32_t min_counts;    /* -32768 to max_counts: plausible counts, others are clamped and flagged */
    int32_t max_counts;    /* up to 32767 */
} plumb_channel_tuning_t;

/* The channels of one axis. */
typedef struct {
    plumb_channel_tuning_t gyro;     /* deg/s */
    plumb_channel_tuning_t accel;    /* g: horizontal at tilt 0, sin(tilt) at rest */
    plumb_channel_tuning_t accel_up; /* g: cos(tilt) at rest */
} plumb_calibration_tuning_t;

/* How tilt is computed from accelerations. */
typedef enum {
    PLUMB_TUNING_ARCSINE = 0, /* asin(accel / 1 g), +-90 deg */
    PLUMB_TUNING_ATAN2 = 1    /* atan2(accel, accel_up), +-180 deg */
} plumb_tilt_choice_t;

/* Gyro sample that drives the filter. */
typedef enum {
    PLUMB_TUNING_RATE_PREVIOUS = 0, /* the sample of the previous step, as in the papers */
    PLUMB_TUNING_RATE_CURRENT = 1,  /* the sample of the present step */
    PLUMB_TUNING_RATE_TRAPEZIUM = 2 /* the mean of both: the rate over the step */
} plumb_rate_choice_t;

/* The two-state filter of tilt and gyro bias. Process noise as densities: Q of a step is the density times
 * the period. */
typedef struct {
    double q_angle_deg2_per_s; /* at least 0 */
    double q_bias_dps2_per_s;  /* (deg/s)^2 per s, at least 0 */
    int32_t rate;              /* plumb_rate_choice_t */
    double bias_max_dps;       /* limit of the published bias: 0 to below 360 */
} plumb_kalman_tuning_t;

/* Measurement variance R from the magnitude of the acceleration a:
 * R = min(r_deg2 + gain_deg2 (|a|^2 - 1 g^2)^2, r_max_deg2). */
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

/* Command in -1 to 1 from the error in deg; the D term acts on the measured rate behind a first-order
 * low-pass.
 */
typedef struct {
    double kp_per_deg;
    double ki_per_deg_s; /* at least 0 */
    double kd_per_dps;
    double derivative_tau_s; /* time constant of the filter, 0: none */
    double slew_per_s;       /* largest change of the command, above 0 */
} plumb_pid_tuning_t;

/* Pulses of speed controllers: mid +- span * command, within min to max; neutral while disarmed. 900 to
 * 2100 us, neutral <= min <= mid <= max, neutral at most 1050 us. */
typedef struct {
    double mid_us;
    double span_us; /* -1200 to 1200; the sign turns the direction */
    double min_us;
    double max_us;
    double neutral_us;
} plumb_esc_tuning_t;

#ifdef __cplusplus
}
#endif

#endif
