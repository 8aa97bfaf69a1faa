/* Error-state filter of gyro and angular accelerometer, in the two stages of Friedland (1969).
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
 * DESIGN.md, "Numbers".
 */
#ifndef PLUMB_CORE_FUSION_H
#define PLUMB_CORE_FUSION_H

#include "fixed.h"
#include <stdbool.h>

enum { FUSION_RATE, FUSION_GYRO_BIAS, FUSION_ANGULAR_BIAS, FUSION_DIFFERENCE, FUSION_ANGLE };
#define FUSION_STATES 4U
#define FUSION_ROWS   5U
#define FUSION_CELLS  14U /* lower triangle of the four states, then the row of the angle */

/* Cell of row i, column j <= i; the angle's row has columns 0..3. */
#define FUSION_CELL(i, j) ((i) * ((i) + 1U) / 2U + (j))

/* Tuning. Variances are in (turn/s)^2 unless stated otherwise, process noise (q_) per step. */
typedef struct {
    uint32_t layer;                /* FUSION_DATA..FUSION_PRINTED */
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
} fusion_params_t;

/* Data layer with the angle a state; attitude layer; data layer as printed: the corrected rate alone turns
 * the quaternion. */
enum { FUSION_DATA, FUSION_ATTITUDE, FUSION_PRINTED };

/* A second-stage parameter: its variance, and the effect of one unit of its error on rate, gyro bias, angular
 * bias and angle. */
#define FUSION_TOUCHED 4U
typedef struct {
    int64_t variance_q60;
    int32_t sensitivity_q28[FUSION_TOUCHED];
} fusion_parameter_t;

/* Inputs of one step of covariance. The couplings depend on what was measured in the step. */
typedef struct {
    bool angular;      /* the rate was propagated by an angular-acceleration sample, hence by its bias */
    bool difference;   /* the difference of the attitudes grows by rate and gyro bias */
    bool gyro_angle;   /* the published angle comes from the gyro: its error grows by the gyro's bias, not by
                          the error of the rate */
    uint64_t rate_q64; /* process noise of the step */
    uint64_t gyro_bias_q64, angular_bias_q64;
} fusion_predict_t;

/* False if a word is outside its range above; words without a range may have any value. */
bool fusion_valid(const fusion_params_t *f);

void fusion_predict(int64_t p[FUSION_CELLS], const fusion_predict_t *step, int32_t dt_s_q32);

/* Covariance of all rows with a gyro measurement: u = P h, h = rate + gyro bias + age * angular bias.
 * age_q24: age of the sample at the step, in steps, 0..2^24. Returns h P h, Q64, at least 0. */
int64_t fusion_project_rate(int64_t p[FUSION_CELLS], int32_t age_q24, int64_t u_q64[FUSION_ROWS]);

/* Covariance of all rows with one state as the measurement; returns that state's variance, Q64. */
int64_t fusion_project_state(int64_t p[FUSION_CELLS], unsigned state, int64_t u_q64[FUSION_ROWS]);

/* 1 / s: reciprocal_q61() of the leading 31 bits of s, and the exponent that goes with it. */
typedef struct {
    uint32_t y_q61;
    unsigned exponent;
} fusion_inverse_t;

fusion_inverse_t fusion_inverse(int64_t s_q64);

/* u / s in Q28, saturated to +-4, for every row; s >= 2^32. */
void fusion_gains(const int64_t u_q64[FUSION_ROWS], int64_t s_q64, int32_t gain_q28[FUSION_ROWS]);

/* P = P - gain u^T. */
void fusion_update(int64_t p[FUSION_CELLS], const int32_t gain_q28[FUSION_ROWS],
                   const int64_t u_q64[FUSION_ROWS]);

/* Propagate the sensitivities by one step. drive_q28: effect of the parameter on the rate in this step. */
void fusion_parameter_predict(fusion_parameter_t *a, bool angular, int32_t drive_q28, int32_t dt_s_q32);

/* Sensitivity of the innovation to the parameter, turn/s Q28 per unit, clamped to +-limit. direct_q28: the
 * part that does not act through the states. */
int32_t fusion_parameter_project(const fusion_parameter_t *a, int32_t age_q24, int32_t direct_q28,
                                 int32_t limit_q28);

/* Update the sensitivities by a measurement, with the gains of the first stage. */
void fusion_parameter_update(fusion_parameter_t *a, const int32_t gain_q28[FUSION_ROWS],
                             int32_t projected_q28);

/* Covariance of the parameter with the innovation, Q60. Times the projected sensitivity it is the parameter's
 * contribution to the variance of the innovation. */
int64_t fusion_parameter_cross(const fusion_parameter_t *a, int32_t projected_q28);

/* Update the parameter's variance by an innovation; returns the parameter's gain, unit per turn/s, Q20.
 * cross_q60: of fusion_parameter_cross(); y: inverse of the innovation's variance. Adds to gain_q28 the part
 * of the correction that the states get through the sensitivities. */
int32_t fusion_parameter_learn(fusion_parameter_t *a, int64_t cross_q60, fusion_inverse_t y,
                               int32_t gain_q28[FUSION_ROWS]);

#endif
