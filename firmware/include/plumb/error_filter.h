/* Kalman filter of the ten errors of an attitude in earth axes: bias and scale of the gyro, tilt, horizontal
 * velocity. It runs inside the step of the system that has it; here is its state.
 *
 * A block of steps ends with its coupling (tilt per bias and scale error) and its lever (velocity per tilt).
 * Then the covariance grows: the velocity by half the lever, the two tilts, the velocity again and every
 * variance. Each scalar measurement follows: weigh, then shrink. Each function is one slice of that work and
 * fits into a step. Sums are modulo 2^32, as no input may make one undefined.
 *
 * docs/reference/arithmetic/attitude.md gives every word.
 */
#ifndef PLUMB_ERROR_FILTER_H
#define PLUMB_ERROR_FILTER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_ERROR_STATES 10 /* bias x, y, z, scale x, y, z, tilt x, y, velocity x, y */

/* What 1 of each state is: bias 1/4 rad/s, scale 1/64, tilt 1 rad, velocity 2 g s. */
typedef struct {
    int32_t covariance_q32[PLUMB_ERROR_STATES * (PLUMB_ERROR_STATES + 1) / 2]; /* lower triangle, by rows */
    int32_t correction_q28[PLUMB_ERROR_STATES];   /* of the last measured block; while aligning, [0]: g s */
    int32_t gain_q28[PLUMB_ERROR_STATES];         /* of the measurement under way */
    int32_t measured_row_q32[PLUMB_ERROR_STATES]; /* row of the covariance that it measures */
    int32_t coupling_q32[2][6];                   /* of the last block: tilt per bias and per scale error */
    int32_t half_lever_q32;  /* of the last block: half of the velocity that a tilt makes, 2 g s per rad */
    int32_t tilt_growth_q32; /* of the last block: what the variance of the tilt grows by, rad^2 */
    int32_t velocity_growth_q32; /* the same of the velocity, 4 g^2 s^2 */
} plumb_error_filter_t;

#ifdef __cplusplus
}
#endif

#endif
