/* The slices of the filter of plumb/error_filter.h, in the order in which a block of steps takes them: the
 * manual is there. */
#ifndef PLUMB_CORE_ERROR_FILTER_H
#define PLUMB_CORE_ERROR_FILTER_H

#include "plumb/error_filter.h"

enum { BIAS = 0, SCALE = 3, TILT = 6, VELOCITY = 8, STATES = PLUMB_ERROR_STATES };

#define VARIANCE_LIMIT_Q32 858993459 /* 0.2: where variances of tilt and velocity stop growing */

/* Covariance of the start, with these variances; no corrections. */
void plumb_error_filter_start(plumb_error_filter_t *e, int32_t bias, int32_t scale, int32_t tilt,
                              int32_t velocity);

/* Variance of one state. */
static inline uint32_t plumb_error_filter_variance(const plumb_error_filter_t *e, unsigned state) {
    return (uint32_t)e->covariance_q32[state * (state + 3U) / 2U];
}

/* The corrections as a block makes them grow: velocity with tilt, tilt with bias and scale. */
void plumb_error_filter_predict(plumb_error_filter_t *e);

/* The horizontal velocity grows with the tilt, by half the lever of the block: before and after the tilt has
 * grown. */
void plumb_error_filter_grow_velocity(plumb_error_filter_t *e);

/* One component of the tilt (0, 1) grows by the errors of the gyro, times the coupling. */
void plumb_error_filter_grow_tilt(plumb_error_filter_t *e, unsigned axis);

/* The velocity once more, then every variance; clears the corrections. */
void plumb_error_filter_grow(plumb_error_filter_t *e, int32_t bias_growth_q32, int32_t scale_growth_q32);

/* Gains and corrections of one scalar measurement: that the error of state `at` is measured_q28, of that
 * variance, below 2^35. One of a bias that is beyond five sigmas changes nothing: the body turns. */
void plumb_error_filter_weigh(plumb_error_filter_t *e, unsigned at, uint64_t variance_q32,
                              int32_t measured_q28);

/* The covariance after that measurement: less gain times row. */
void plumb_error_filter_shrink(plumb_error_filter_t *e);

#endif
