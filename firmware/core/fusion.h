/* The slices of the filter that plumb/fusion.h describes, in the order in which a step calls them. */
#ifndef PLUMB_CORE_FUSION_H
#define PLUMB_CORE_FUSION_H

#include "fixed.h"
#include "plumb/fusion.h"
#include <stdbool.h>

enum { FUSION_RATE, FUSION_GYRO_BIAS, FUSION_ANGULAR_BIAS, FUSION_DIFFERENCE, FUSION_ANGLE };
#define FUSION_STATES 4U
#define FUSION_ROWS   5U
#define FUSION_CELLS  14U /* lower triangle of the four states, then the row of the angle */

/* Cell of row i, column j <= i; the angle's row has columns 0..3. */
#define FUSION_CELL(i, j) ((i) * ((i) + 1U) / 2U + (j))

/* Inputs of one step of covariance. The couplings depend on what was measured in the step. */
typedef struct {
    bool angular;      /* the rate was propagated by an angular-acceleration sample, hence by its bias */
    bool difference;   /* the difference of the attitudes grows by rate and gyro bias */
    bool gyro_angle;   /* the published angle comes from the gyro: its error grows by the gyro's bias, not by
                          the error of the rate */
    uint64_t rate_q64; /* process noise of the step */
    uint64_t gyro_bias_q64, angular_bias_q64;
} fusion_predict_t;

void plumb_fusion_predict(int64_t p[FUSION_CELLS], const fusion_predict_t *step, int32_t dt_s_q32);

/* Covariance of all rows with a gyro measurement: u = P h, h = rate + gyro bias + age * angular bias.
 * age_q24: age of the sample at the step, in steps, 0..2^24. Returns h P h, Q64, at least 0. */
int64_t plumb_fusion_project_rate(int64_t p[FUSION_CELLS], int32_t age_q24, int64_t u_q64[FUSION_ROWS]);

/* Covariance of all rows with one state as the measurement; returns that state's variance, Q64. */
int64_t plumb_fusion_project_state(int64_t p[FUSION_CELLS], unsigned state, int64_t u_q64[FUSION_ROWS]);

/* 1 / s: reciprocal_q61() of the leading 31 bits of s, and the exponent that goes with it. */
typedef struct {
    uint32_t y_q61;
    unsigned exponent;
} fusion_inverse_t;

fusion_inverse_t plumb_fusion_inverse(int64_t s_q64);

/* u / s in Q28, saturated to +-4, for every row; s >= 2^32. */
void plumb_fusion_gains(const int64_t u_q64[FUSION_ROWS], int64_t s_q64, int32_t gain_q28[FUSION_ROWS]);

/* P = P - gain u^T. */
void plumb_fusion_update(int64_t p[FUSION_CELLS], const int32_t gain_q28[FUSION_ROWS],
                         const int64_t u_q64[FUSION_ROWS]);

/* Propagate the sensitivities by one step. drive_q28: effect of the parameter on the rate in this step. */
void plumb_fusion_parameter_predict(plumb_fusion_parameter_t *a, bool angular, int32_t drive_q28,
                                    int32_t dt_s_q32);

/* Sensitivity of the innovation to the parameter, turn/s Q28 per unit, clamped to +-limit. direct_q28: the
 * part that does not act through the states. */
int32_t plumb_fusion_parameter_project(const plumb_fusion_parameter_t *a, int32_t age_q24, int32_t direct_q28,
                                       int32_t limit_q28);

/* Update the sensitivities by a measurement, with the gains of the first stage. */
void plumb_fusion_parameter_update(plumb_fusion_parameter_t *a, const int32_t gain_q28[FUSION_ROWS],
                                   int32_t projected_q28);

/* Covariance of the parameter with the innovation, Q60. Times the projected sensitivity it is the parameter's
 * contribution to the variance of the innovation. */
int64_t plumb_fusion_parameter_cross(const plumb_fusion_parameter_t *a, int32_t projected_q28);

/* Update the parameter's variance by an innovation; returns the parameter's gain, unit per turn/s, Q20.
 * cross_q60: of plumb_fusion_parameter_cross(); y: inverse of the innovation's variance. Adds to gain_q28 the
 * part of the correction that the states get through the sensitivities. */
int32_t plumb_fusion_parameter_learn(plumb_fusion_parameter_t *a, int64_t cross_q60, fusion_inverse_t y,
                                     int32_t gain_q28[FUSION_ROWS]);

#endif
