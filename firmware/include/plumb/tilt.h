/* Acceleration -> measured tilt, and its variance.
 *
 * Positive tilt is the rotation that turns gravity's reaction from the z axis towards the y axis: at rest
 * accel_y = sin(tilt) g, accel_z = cos(tilt) g. */
#ifndef PLUMB_TILT_H
#define PLUMB_TILT_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_TILT_ARCSINE 0U /* asin(accel_y / 1 g), +-90 degrees; beyond 1 g it stays at +-90 */
#define PLUMB_TILT_ATAN2   1U /* atan2(accel_y, accel_z), +-180 degrees */

/* Settings. */
typedef struct {
    uint32_t mode;            /* PLUMB_TILT_ARCSINE or PLUMB_TILT_ATAN2 */
    uint32_t r_base;          /* measurement variance at |a| = 1 g, in 2^32 lsb of the filter; 1..2^24 */
    uint32_t r_gain;          /* of plumb_tilt_variance(); 0: R is r_base */
    uint32_t r_max;           /* r_base..2^24 */
    uint32_t deviation_max;   /* | |a|^2 - 1 | is clamped here, g^2 Q20; shifted below 2^32 */
    uint32_t deviation_shift; /* 0..31 */
} plumb_tilt_params_t;

/* Measured tilt, turn Q32, from accelerations of any size, g Q26. */
int32_t plumb_tilt_angle(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26);

/* Its variance R = min(r_base + r_gain * (|a|^2 - 1 g^2)^2, r_max), in 2^32 lsb of the filter, for
 * accelerations within +-PLUMB_CALIBRATION_LIMIT:
 *
 *     d = min(| ((ay^2 + az^2) >> 32) - 2^20 |, deviation_max) << deviation_shift
 *     R = min(r_base + ((((d^2) >> 32) * r_gain) >> 32), r_max)
 *
 * R depends on this sample alone, and has no dead band. */
uint32_t plumb_tilt_variance(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26);

/* Mode and ranges, and that r_base + r_gain * (largest deviation)^2 does not overflow. */
bool plumb_tilt_valid(const plumb_tilt_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
