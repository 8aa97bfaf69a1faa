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
#ifndef PLUMB_CORE_BALANCER_H
#define PLUMB_CORE_BALANCER_H

#include "control_params.h"
#include "core/plausibility.h"

#define BALANCER_FLAG_GYRO_CLAMPED     (1U << 0)
#define BALANCER_FLAG_ACCEL_X_CLAMPED  (1U << 1)
#define BALANCER_FLAG_ACCEL_Z_CLAMPED  (1U << 2)
#define BALANCER_FLAG_COMMAND_LIMITED  (1U << 3)
#define BALANCER_FLAG_WHEEL_CLAMPED    (1U << 4)
#define BALANCER_FLAG_LEAN_LIMITED     (1U << 5)
#define BALANCER_FLAG_SETPOINT_CLAMPED (1U << 6)
#define BALANCER_FLAG_FALLEN           (1U << 7) /* kept until the run ends: the duty is 0 */
/* Raw counts outside their range. */
#define BALANCER_FLAGS_SATURATED                                                                             \
    (BALANCER_FLAG_GYRO_CLAMPED | BALANCER_FLAG_ACCEL_X_CLAMPED | BALANCER_FLAG_ACCEL_Z_CLAMPED |            \
     BALANCER_FLAG_WHEEL_CLAMPED)

typedef struct {
    int32_t raw[CONTROL_RAW_MAX]; /* counts, as given: gyro, forward, up, Hall edges modulo 2^16 */
    int32_t setpoint_mps_q26;     /* velocity asked for */
    int32_t rate_turnps_q28;      /* calibrated gyro */
    int32_t accel_x_g_q26;        /* reaction to gravity: sin(tilt) at rest */
    int32_t accel_z_g_q26;
    wheel_t wheel;
    int32_t gravity_x_g_q26; /* accel_x, the axle's acceleration taken off */
    int32_t tilt_measured_turn_q32;
    uint32_t variance; /* R of this step, in 2^32 lsb */
    kalman_t kalman;
    int32_t tilt_turn_q32;             /* fused */
    int32_t bias_turnps_q28;           /* estimated */
    int32_t rate_corrected_turnps_q28; /* rate - bias */
    uint32_t clamped_steps;            /* so far, steps with any raw count outside its range */
    pid_t speed;                       /* error in m/s Q26, rate is the axle's acceleration in g Q25 */
    pid_t pid;                         /* of the lean */
    int32_t lean_turn_q32;             /* the tilt that the speed loop asks for */
    int32_t duty_q15;                  /* of the bridge, -32767..32767 */
    uint32_t flags;                    /* BALANCER_FLAG_* of this step */
    uint32_t step;                     /* number of this step in the run, from 1 */
} balancer_words_t;

/* Its state is its record. */
typedef struct {
    balancer_words_t words;
} balancer_t;

/* All words become zero but those of the filter's start. */
void balancer_init(balancer_t *c, const control_params_t *p);

/* False if any sum of the step could overflow. */
bool balancer_params_valid(const control_params_t *p);

/* One step. raw: gyro about the axle, acceleration forward and up, count of Hall edges, two unused; setpoint:
 * velocity, m/s Q26. The result is c->words. */
void balancer_step(balancer_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                   int32_t setpoint_mps_q26);

/* What its sensors can say, and when it may be armed. */
extern const plausibility_bounds_t balancer_plausibility;

#endif
