/* State of the Kalman filter of the errors of an attitude: bias and scale of the gyro, tilt, horizontal
 * velocity. It runs inside the step of the system that has it; its equations are in
 * firmware/core/error_filter.h. */
#ifndef PLUMB_ERROR_FILTER_H
#define PLUMB_ERROR_FILTER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_ERROR_STATES 10 /* bias x, y, z, scale x, y, z, tilt x, y, velocity x, y */

/* What 1 of each state is: bias 1/4 rad/s, scale 1/64, tilt 1 rad, velocity 1 g s. */
typedef struct {
    int32_t covariance_q32[PLUMB_ERROR_STATES * (PLUMB_ERROR_STATES + 1) / 2]; /* lower triangle, by rows */
    int32_t correction_q28[PLUMB_ERROR_STATES];   /* of the last measured block; while aligning, [0]: g s */
    int32_t gain_q28[PLUMB_ERROR_STATES];         /* of the measurement under way */
    int32_t measured_row_q32[PLUMB_ERROR_STATES]; /* row of the covariance that it measures */
    int32_t coupling_q32[2][6];                   /* of the last block: tilt per bias and per scale error */
    int32_t half_lever_q32;  /* of the last block: half of the velocity that a tilt makes, g s per rad */
    int32_t tilt_growth_q32; /* of the last block: what the variance of the tilt grows by, rad^2 */
    int32_t velocity_growth_q32;
} plumb_error_filter_t;

#ifdef __cplusplus
}
#endif

#endif
