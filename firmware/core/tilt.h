/* Acceleration -> measured tilt, and how far to trust it.
 *
 * Positive tilt is the rotation that turns gravity's reaction from the z axis towards the y axis: at rest
 * accel_y = sin(tilt) g, accel_z = cos(tilt) g.
 */
#ifndef PLUMB_CORE_TILT_H
#define PLUMB_CORE_TILT_H

#include "fixed.h"
#include <stdbool.h>

#define TILT_ARCSINE 0U /* asin(accel_y / 1 g), +-90 degrees; beyond 1 g it stays at +-90 */
#define TILT_ATAN2   1U /* atan2(accel_y, accel_z), +-180 degrees */

typedef struct {
    uint32_t mode;   /* TILT_ARCSINE or TILT_ATAN2 */
    uint32_t r_base; /* measurement variance at |a| = 1 g, in 2^32 lsb of the filter; 1..2^24 */
    uint32_t r_gain; /* see tilt_variance; 0 keeps r_base */
    uint32_t r_max;  /* r_base..2^24 */
    uint32_t
        deviation_max; /* | |a|^2 - 1 | is clamped here, g^2 Q20; deviation_max << deviation_shift < 2^32 */
    uint32_t deviation_shift; /* 0..31 */
} tilt_params_t;

/* Measured tilt, turn Q32. *limited becomes 1 if the arcsine had to be limited, else 0. */
int32_t tilt_angle(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26, uint32_t *limited);

/* r = min(r_base + r_gain * (|a|^2 - 1 g^2)^2, r_max), for accelerations within +-CALIBRATION_LIMIT:
 *     d = min(| ((ay^2 + az^2) >> 32) - 2^20 |, deviation_max) << deviation_shift
 *     r = min(r_base + ((((d^2) >> 32) * r_gain) >> 32), r_max)
 * No memory, no dead band. */
uint32_t tilt_variance(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26);

bool tilt_valid(const tilt_params_t *p);

#endif
