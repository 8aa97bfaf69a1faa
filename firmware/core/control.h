/* One step of control: raw counts in, actuator pulses out, every intermediate kept.
 *
 *     counts -> calibration -> tilt, trust -> kalman -> pid -> pulses of the two opposing motors
 *
 * The caller owns all memory. A step depends on nothing but its arguments and *c. control_words_t is the
 * record of a step: the digest is the CRC-32 of its bytes, little-endian, as they stand here; this order is
 * the written order. No output depends on arming or on time.
 */
#ifndef PLUMB_CORE_CONTROL_H
#define PLUMB_CORE_CONTROL_H

#include "calibration.h"
#include "kalman.h"
#include "pid.h"
#include "tilt.h"

#define CONTROL_RAW_MAX 6

/* Pulses in half-microseconds: mid +- span * command, within [min, max]. neutral is what the board sends
 * while disarmed; control_step does not use it. */
typedef struct {
    int32_t mid_halfus;     /* 0..16383 */
    int32_t span_halfus;    /* -16383..16383; the sign turns the direction */
    int32_t min_halfus;     /* 0..16383 */
    int32_t max_halfus;     /* min..16383 */
    int32_t neutral_halfus; /* 0..16383 */
} esc_params_t;

typedef struct {
    calibration_params_t gyro;    /* turn/s Q28, from raw[0] */
    calibration_params_t accel_y; /* g Q26, from raw[1] */
    calibration_params_t accel_z; /* g Q26, from raw[2] */
    tilt_params_t tilt;
    kalman_params_t kalman;
    kalman_start_t start;
    pid_params_t pid;
    esc_params_t esc;
} control_params_t;

#define CONTROL_FLAG_GYRO_CLAMPED    (1U << 0)
#define CONTROL_FLAG_ACCEL_Y_CLAMPED (1U << 1)
#define CONTROL_FLAG_ACCEL_Z_CLAMPED (1U << 2)
#define CONTROL_FLAG_COMMAND_LIMITED (1U << 3)

typedef struct {
    int32_t raw[CONTROL_RAW_MAX]; /* counts, as given */
    int32_t setpoint_turn_q32;
    int32_t rate_turnps_q28; /* calibrated gyro */
    int32_t accel_y_g_q26;
    int32_t accel_z_g_q26;
    int32_t tilt_measured_turn_q32;
    uint32_t variance; /* R of this step, in 2^32 lsb */
    kalman_t kalman;
    int32_t tilt_turn_q32;             /* fused */
    int32_t bias_turnps_q28;           /* estimated */
    int32_t rate_corrected_turnps_q28; /* rate - bias */
    uint32_t clamped_steps;            /* so far, steps with any raw count outside its range */
    pid_t pid;
    uint32_t pulse_halfus[2];
    uint32_t flags; /* CONTROL_FLAG_* of this step */
    uint32_t step;  /* number of this step in the run, from 1 */
} control_words_t;

/* A whole controller: its state is its record. */
typedef struct {
    control_words_t words;
} control_t;

/* State at the start of a run. All words become zero but those of the filter's and the pid's state. */
void control_init(control_t *c, const control_params_t *p);

/* What ranges of single parameters cannot express: false if any sum of the step could overflow. 64-bit
 * products, no division; for the moment of commit, not for every step. */
bool control_params_valid(const control_params_t *p);

/* One step. raw: counts; setpoint: turn Q32. The result is c->words. */
void control_step(control_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                  int32_t setpoint_turn_q32);

#endif
