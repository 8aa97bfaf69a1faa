/* Error-state filter of gyro and angular accelerometer, in the two stages of Friedland (1969). It runs inside
 * the step of the system that has it; here are its parameters and the state of its second stage.
 *
 * First stage, one covariance for the three axes, because they share noise and sampling instants: errors of
 *
 *     [0] rate            turn/s
 *     [1] gyro bias       turn/s
 *     [2] angular bias    of the angular accelerometer, turn/s per four steps
 *     [3] difference      of the two attitudes, turn per step (attitude layer only)
 *     and, as a row without a variance of its own, the published angle, turn.
 *
 * Second stage, one per axis and parameter: the difference in scale between gyro and angular accelerometer,
 * and the gyro's lag. sensitivity[] is the effect of one unit of the parameter's error on the states above.
 * That is exact for constant parameters, and needs no larger covariance.
 *
 * Covariances are in Q64 of the squared units, gains in Q28, sensitivities in Q28. Why every sum fits:
 * docs/reference/arithmetic/kernels.md.
 */
#ifndef PLUMB_FUSION_H
#define PLUMB_FUSION_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Data layer with the angle a state; attitude layer; data layer as printed: the corrected rate alone turns
 * the quaternion. */
enum { PLUMB_FUSION_DATA, PLUMB_FUSION_ATTITUDE, PLUMB_FUSION_PRINTED };

#define PLUMB_FUSION_TOUCHED 4U /* states that a parameter of the second stage acts on */

/* Tuning. Variances are in (turn/s)^2 unless stated otherwise, process noise (q_) per step. */
typedef struct {
    uint32_t layer;                /* PLUMB_FUSION_DATA..PLUMB_FUSION_PRINTED */
    int32_t dt_s_q32;              /* period of a step: 1..2^26 */
    int32_t step_hz_q16;           /* inverse of the period: 1..2^31-1 */
    uint32_t gyro_period_step_q24; /* of the gyro's samples: 2^24..2^28, 1 to 16 steps */
    uint32_t gyro_age_step_q24;    /* age of the newest gyro sampling instant at step 0: below the period */
    int32_t gyro_samples_step_q30; /* gyro samples per step: 2^26..2^30 */
    uint32_t rest_steps;           /* steps at rest at the beginning of the run */
    int32_t lag_step_q24;          /* the gyro's: 0..2^28, up to 16 steps */
    int32_t lag_alpha_q31;         /* 1 - exp(-1 / lag), at least 0; the largest value is no lag */
    int32_t share_q30;             /* the gyro's share of a difference in scale: 0..2^30 */
    uint32_t r_gyro_q44;           /* R of a gyro sample: at least 2^12 */
    uint32_t q_rate_q52;           /* Q of the rate, propagated by the angular accelerometer */
    uint32_t q_rate_lost_q44;      /* Q of the rate, without the angular accelerometer */
    uint32_t q_gyro_bias_q60;      /* random walk of the gyro's bias */
    uint32_t q_angular_bias_q64;   /* random walk of the angular bias: (turn/s per four steps)^2 */
    uint32_t p_gyro_bias_q40;      /* variance at the start */
    uint32_t p_angular_bias_q52;   /* variance at the start: (turn/s per four steps)^2 */
    uint32_t v_scale_q40;          /* variance of the difference in scale; 0: not estimated */
    uint32_t v_lag_q30;            /* variance of the lag, steps^2: 0..2^30; 0: not estimated */
} plumb_fusion_params_t;

/* A parameter of the second stage: its variance, and the effect of one unit of its error on rate, gyro bias,
 * angular bias and angle. */
typedef struct {
    int64_t variance_q60;
    int32_t sensitivity_q28[PLUMB_FUSION_TOUCHED];
} plumb_fusion_parameter_t;

/* False if a word is outside its range; each word has one above, those without are of any value. */
bool plumb_fusion_valid(const plumb_fusion_params_t *f);

#ifdef __cplusplus
}
#endif

#endif
