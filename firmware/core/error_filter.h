/* The slices of the filter that plumb/error_filter.h describes, in the order in which a block of steps calls
 * them. */
#ifndef PLUMB_CORE_ERROR_FILTER_H
#define PLUMB_CORE_ERROR_FILTER_H

#include "plumb/error_filter.h"

enum { BIAS = 0, SCALE = 3, TILT = 6, VELOCITY = 8, STATES = PLUMB_ERROR_STATES };

#define VARIANCE_LIMIT_Q32 858993459 /* 0.2: variances of tilt and velocity grow no further */

/* Set the covariance at the start from these variances, and clear the corrections. */
void plumb_error_filter_start(plumb_error_filter_t *e, int32_t bias, int32_t scale, int32_t tilt,
                              int32_t velocity);

/* Variance of one state. */
static inline uint32_t plumb_error_filter_variance(const plumb_error_filter_t *e, unsigned state) {
    return (uint32_t)e->covariance_q32[state * (state + 3U) / 2U];
}

/* Propagate the corrections over a block: velocity by tilt, tilt by bias and scale. */
void plumb_error_filter_predict(plumb_error_filter_t *e);

/* Propagate the errors of the horizontal velocity by those of the tilt, over half the lever of the block.
 * Call once before and once after the tilt is propagated. */
void plumb_error_filter_grow_velocity(plumb_error_filter_t *e);

/* Propagate the error of one component of the tilt (0, 1) by the errors of the gyro, times the coupling. */
void plumb_error_filter_grow_tilt(plumb_error_filter_t *e, unsigned axis);

/* Propagate the velocity again, add the growth to every variance, and clear the corrections. */
void plumb_error_filter_grow(plumb_error_filter_t *e, int32_t bias_growth_q32, int32_t scale_growth_q32);

/* Gains and corrections of one scalar measurement: the error of state `at` is measured_q28, with variance
 * variance_q32, below 2^35. A measurement of a bias beyond five sigmas is ignored: the body is turning. */
void plumb_error_filter_weigh(plumb_error_filter_t *e, unsigned at, uint64_t variance_q32,
                              int32_t measured_q28);

/* Subtract gain times row from the covariance, after that measurement. */
void plumb_error_filter_shrink(plumb_error_filter_t *e);

#endif
