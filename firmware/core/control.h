/* One control step of `quad`: raw counts -> calibration -> tilt -> Kalman -> PID -> pulses.
 *
 * Pure integers, no hardware, no clock, no heap; the caller owns all memory. Output words never depend on
 * arming. DESIGN.md, "Numbers", specifies every bit. */
#ifndef PLUMB_CORE_CONTROL_H
#define PLUMB_CORE_CONTROL_H

#include "calibration.h"
#include "kalman.h"
#include "pid.h"
#include "tilt.h"
#include <stdbool.h>
#include <stdint.h>

#define CONTROL_RAW_MAX 6 /* raw words of a sample; quad uses gyro, y, z */

/* Pulses of the two opposing motors, in units of 0.5 us: mid +- span * command, clamped. */
typedef struct {
    int32_t mid_halfus;
    int32_t span_halfus; /* 0 .. 8191 */
    int32_t min_halfus;
    int32_t max_halfus;     /* .. 65535 */
    int32_t neutral_halfus; /* what a disarmed board sends; the control step does not use it */
} esc_params_t;

/* Everything the host sets, in 32-bit words: the order of the parameter table. */
typedef struct {
    calibration_t gyro;
    calibration_t accel_y;
    calibration_t accel_z;
    tilt_params_t tilt;
    kalman_params_t kalman;
    pid_params_t pid;
    esc_params_t esc;
} control_params_t;

/* What was clamped in a step (control_words_t.saturated). */
#define CONTROL_SATURATED_GYRO    UINT32_C(1)
#define CONTROL_SATURATED_ACCEL_Y UINT32_C(2)
#define CONTROL_SATURATED_ACCEL_Z UINT32_C(4)
#define CONTROL_SATURATED_COMMAND UINT32_C(8) /* output or slew limit */

/* The words of a step: raw inputs, intermediates, outputs, in the written order that the digest is taken
 * over. Little endian, no padding. */
typedef struct {
    int32_t raw[CONTROL_RAW_MAX]; /* as used: clamped; channels that the system does not use are 0 */
    int32_t setpoint_turn_q32;
    int32_t rate_turnps_q28;
    int32_t accel_y_g_q26;
    int32_t accel_z_g_q26;
    int32_t tilt_measured_turn_q32;
    uint32_t saturated;
    kalman_t kalman;
    int32_t rate_corrected_turnps_q28;
    int32_t error_turn_q32;
    pid_state_t pid;
    int32_t pulse_halfus[2];
} control_words_t;

typedef struct {
    control_words_t words;
    int32_t rate_previous_turnps_q28;
    uint32_t started; /* 0 until the first step is done */
} control_t;

/* Cross-field checks that word ranges cannot express; false: these parameters could overflow. */
bool control_params_valid(const control_params_t *p);

/* Start over: state, covariance and words as before the first sample. */
void control_init(control_t *c, const control_params_t *p);

/* One step. The result is c->words; c->words.pulse_halfus goes to the actuator if the board is armed. */
void control_step(control_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                  int32_t setpoint_turn_q32);

#endif
