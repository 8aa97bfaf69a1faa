/* One axis of a quadrotor: raw counts in, pulses of two opposing motors out, every intermediate kept.
 *
 *     counts -> calibration -> tilt, trust -> kalman -> pid -> pulses of the two opposing motors
 */
#ifndef PLUMB_CORE_QUAD_H
#define PLUMB_CORE_QUAD_H

#include "control_params.h"
#include "core/plausibility.h"

#define QUAD_FLAG_GYRO_CLAMPED    (1U << 0)
#define QUAD_FLAG_ACCEL_Y_CLAMPED (1U << 1)
#define QUAD_FLAG_ACCEL_Z_CLAMPED (1U << 2)
#define QUAD_FLAG_COMMAND_LIMITED (1U << 3)
/* Raw counts outside their range; a limited command is no such thing. */
#define QUAD_FLAGS_SATURATED (QUAD_FLAG_GYRO_CLAMPED | QUAD_FLAG_ACCEL_Y_CLAMPED | QUAD_FLAG_ACCEL_Z_CLAMPED)

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
    uint32_t flags; /* QUAD_FLAG_* of this step */
    uint32_t step;  /* number of this step in the run, from 1 */
} quad_words_t;

/* Its state is its record. */
typedef struct {
    quad_words_t words;
} quad_t;

/* All words become zero but those of the filter's and the pid's state. */
void quad_init(quad_t *c, const control_params_t *p);

/* False if any sum of the step could overflow: 64-bit products, no division. */
bool quad_params_valid(const control_params_t *p);

/* One step. raw: gyro (turn/s Q28 by its calibration), acceleration along y and z (g Q26), three unused;
 * setpoint: turn Q32. The result is c->words. */
void quad_step(quad_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
               int32_t setpoint_turn_q32);

/* What its sensors can say, and when it may be armed. */
extern const plausibility_bounds_t quad_plausibility;

#endif
