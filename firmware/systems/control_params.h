/* What a step is tuned by: every system's parameters in one flat table of 32-bit words.
 *
 * The order is that of host/plumb/parameters.toml, word for word: first which system it is, then the groups
 * that systems share, then each system's own. A system reads its groups and leaves the others alone.
 */
#ifndef PLUMB_CORE_CONTROL_PARAMS_H
#define PLUMB_CORE_CONTROL_PARAMS_H

#include "core/calibration.h"
#include "core/fusion.h"
#include "core/kalman.h"
#include "core/pid.h"
#include "core/prefilter.h"
#include "core/tilt.h"
#include "core/wheel.h"

#define CONTROL_RAW_MAX 6 /* raw counts of a step; a system uses the first few */

/* control_params_t.system */
#define CONTROL_QUAD      0U
#define CONTROL_BALANCER  1U
#define CONTROL_TURNTABLE 2U
#define CONTROL_PHONE     3U

/* Pulses of one-way speed controllers in half-microseconds: mid +- span * command, within [min, max]. neutral
 * is what the board sends while disarmed; no step uses it. esc.h has the bounds. */
typedef struct {
    int32_t mid_halfus;     /* min..max */
    int32_t span_halfus;    /* -2400..2400; the sign turns the direction */
    int32_t min_halfus;     /* neutral..mid */
    int32_t max_halfus;     /* mid..4200 */
    int32_t neutral_halfus; /* 1800..2200: motor off */
} esc_params_t;

/* Duty of the bridge: span * command, within +-duty_max. No tilt beyond fall: the vehicle lies. */
typedef struct {
    int32_t speed_max_mps_q26; /* 0..8 m/s: the setpoint is clamped to it */
    int32_t lean_max_turn_q34; /* 0..2^30: the lean that a command of 1 of the speed loop asks for */
    int32_t span_q15;          /* -32767..32767; the sign turns the direction */
    int32_t duty_max_q15;      /* 0..32767 */
    uint32_t fall_turn_q32;    /* 0..2^31, which no tilt is beyond */
} drive_params_t;

#define PHONE_BODY_RATES  0U /* pitch' = wy, roll' = wx: the source */
#define PHONE_EULER_RATES 1U

typedef struct {
    uint32_t rates; /* PHONE_BODY_RATES or PHONE_EULER_RATES */
} phone_params_t;

/* The filter of roll: its own noise and start; period, choice of rate and limit of the bias are those of the
 * group kalman. The lsb of its variances is its own, too. */
typedef struct {
    uint32_t r_base;       /* variance of the measurement, 2^32 lsb; 1..2^24 */
    uint32_t r_max;        /* of one that is left out; r_base..2^24 */
    uint32_t qa_hi, qa_lo; /* as in kalman_params_t */
    uint32_t qb;
    uint32_t qb_frac_q30;
    kalman_start_t start;
} roll_params_t;

typedef struct {
    uint32_t system;              /* CONTROL_* */
    calibration_params_t gyro;    /* turn/s Q28 */
    calibration_params_t accel_y; /* g Q26 */
    calibration_params_t accel_z; /* g Q26 */
    tilt_params_t tilt;
    kalman_params_t kalman;
    kalman_start_t start;
    pid_params_t pid;
    esc_params_t esc;
    wheel_params_t wheel; /* balancer */
    pid_params_t speed;   /* balancer: velocity error -> lean */
    drive_params_t drive; /* balancer */
    phone_params_t phone;
    roll_params_t roll;
    calibration_params_t angular;      /* turntable: angular acceleration, turn/s^2 Q28 */
    prefilter_params_t gyro_filter;    /* turntable */
    prefilter_params_t angular_filter; /* turntable */
    fusion_params_t fusion;            /* turntable */
} control_params_t;

#endif
