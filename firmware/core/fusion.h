/* The error filter of gyro and angular accelerometer, in the two stages of Friedland (1969).
 *
 * First stage, shared by the three axes, because their noise and their samples are: errors of
 *
 *     [0] rate            turn/s
 *     [1] gyro bias       turn/s
 *     [2] angular bias    of the angular accelerometer, turn/s per four steps
 *     [3] difference      of the two attitudes, turn per step (attitude layer only)
 *     and, as a row without a variance of its own, the published angle, turn.
 *
 * Second stage, one per axis and parameter: by how much gyro and angular accelerometer differ in scale, and
 * the gyro's lag. sensitivity[] says what one unit of the parameter's error has done to the states above;
 * that is exact for parameters that do not change, and needs no larger covariance.
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

/* What the filter is tuned by. Variances are squares of turn/s unless said, those of a step per step. */
typedef struct {
    uint32_t layer;                /* FUSION_DATA..FUSION_PRINTED */
    int32_t dt_s_q32;              /* period of a step: 1..2^26 */
    int32_t step_hz_q16;           /* its inverse: 1..2^31-1 */
    uint32_t gyro_period_step_q24; /* of the gyro's samples: 2^24..2^28, 1 to 16 steps */
    uint32_t gyro_age_step_q24;    /* time of step 0 since the sampling instant before it: below the period */
    int32_t gyro_samples_step_q30; /* gyro samples per step: 2^26..2^30 */
    uint32_t rest_steps;           /* the run begins with so many at rest */
    int32_t lag_step_q24;          /* the gyro's: 0..2^28, up to 16 steps */
    int32_t lag_alpha_q31;         /* 1 - exp(-1 / lag), at least 0; the largest value is no lag */
    int32_t share_q30;             /* of a difference in scale that is the gyro's: 0..2^30 */
    uint32_t r_gyro_q44;           /* of a gyro sample: at least 2^12 */
    uint32_t q_rate_q52;           /* of the rate, driven by the angular accelerometer */
    uint32_t q_rate_lost_q44;      /* the same without it */
    uint32_t q_gyro_bias_q60;      /* walk of the gyro's bias */
    uint32_t q_angular_bias_q64;   /* of the other one's: squares of turn/s per four steps */
    uint32_t p_gyro_bias_q40;      /* at the start */
    uint32_t p_angular_bias_q52;   /* squares of turn/s per four steps */
    uint32_t v_scale_q40;          /* variance of the difference in scale; 0: not estimated */
    uint32_t v_lag_q30;            /* of the lag, squares of a step: 0..2^30; 0: not estimated */
} fusion_params_t;

/* Data layer with the angle a state; attitude layer; data layer as printed: the corrected rate alone turns
 * the quaternion. */
enum { FUSION_DATA, FUSION_ATTITUDE, FUSION_PRINTED };

/* A second-stage parameter: its variance, and what a unit of its error has done to rate, gyro bias, angular
 * bias and angle. */
#define FUSION_TOUCHED 4U
typedef struct {
    int64_t variance_q60;
    int32_t sensitivity_q28[FUSION_TOUCHED];
} fusion_parameter_t;

/* One step of covariance. Which errors drive which differs with what was measured in the step. */
typedef struct {
    bool angular;      /* the rate was propagated by an angular-acceleration sample, hence by its bias */
    bool difference;   /* the difference of the attitudes grows by rate and gyro bias */
    bool gyro_angle;   /* the published angle is the gyro's: it loses by the gyro's bias, not by the rate */
    uint64_t rate_q64; /* process noise of the step */
    uint64_t gyro_bias_q64, angular_bias_q64;
} fusion_predict_t;

/* False if a word is outside its range; each word has one above, those without are of any value. */
bool fusion_valid(const fusion_params_t *f);

void fusion_predict(int64_t p[FUSION_CELLS], const fusion_predict_t *step, int32_t dt_s_q32);

/* Covariance with the measurement h: u = P h for all rows. age_q24: the sample is older than the step by so
 * many steps, 0..2^24. h = rate + gyro bias + age * angular bias; returns h P h, Q64, never
 * below 0. */
int64_t fusion_project_rate(int64_t p[FUSION_CELLS], int32_t age_q24, int64_t u_q64[FUSION_ROWS]);

/* The same with one state as the measurement. */
int64_t fusion_project_state(int64_t p[FUSION_CELLS], unsigned state, int64_t u_q64[FUSION_ROWS]);

/* 1 / s: reciprocal_q61 of its first 31 bits, and the exponent that is missing then. */
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

/* Sensitivities through a step. drive_q28: what the parameter did to the rate in it. */
void fusion_parameter_predict(fusion_parameter_t *a, bool angular, int32_t drive_q28, int32_t dt_s_q32);

/* Sensitivity of the innovation, turn/s Q28 per unit, within +-limit: direct is the part that does not go
 * through the states. */
int32_t fusion_parameter_project(const fusion_parameter_t *a, int32_t age_q24, int32_t direct_q28,
                                 int32_t limit_q28);

/* Sensitivities through a measurement with the gains of the first stage. */
void fusion_parameter_update(fusion_parameter_t *a, const int32_t gain_q28[FUSION_ROWS],
                             int32_t projected_q28);

/* Covariance of the parameter with the innovation, Q60, and what it contributes to the innovation's variance:
 * Q64 of that times the projected sensitivity. */
int64_t fusion_parameter_cross(const fusion_parameter_t *a, int32_t projected_q28);

/* The parameter's gain (unit per turn/s, Q20) at an innovation with this inverse of its variance, the
 * parameter's variance after it, and the share of the states in it, added to gain_q28. */
int32_t fusion_parameter_learn(fusion_parameter_t *a, int64_t cross_q60, fusion_inverse_t y,
                               int32_t gain_q28[FUSION_ROWS]);

#endif
