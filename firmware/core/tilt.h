/* Acceleration to tilt, and how far to trust it. */
#ifndef PLUMB_CORE_TILT_H
#define PLUMB_CORE_TILT_H

#include <stdint.h>

#define TILT_ONE_G_Q26 (INT32_C(1) << 26)

typedef enum { TILT_ARCSINE = 0, TILT_ATAN2 = 1 } tilt_mode_t;

/* Measurement variance R = min(base + gain * (|a|^2 - 1 g^2)^2, max), in the filter's unit of R. */
typedef struct {
    uint32_t mode;          /* tilt_mode_t */
    uint32_t variance_base; /* 4 .. variance_max */
    uint32_t variance_gain; /* per g^4 */
    uint32_t variance_max;  /* .. 2^27 */
} tilt_params_t;

/* Tilt of the axis: arcsine of y against 1 g (clamped to +-1 g), or atan2(y, z). Positive y is positive tilt.
 */
int32_t tilt_measure(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26);

/* R of this sample. |acceleration| <= 16 g per axis; | |a|^2 - 1 g^2 | counts up to 8 g^2. */
uint32_t tilt_variance(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26);

#endif
