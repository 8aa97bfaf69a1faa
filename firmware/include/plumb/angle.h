/* Angles from ratios and ratios from angles, as binary angles: int32, a full turn is 2^32 (180 deg: -2^31).
 * Integers alone, any argument is allowed. */
#ifndef PLUMB_ANGLE_H
#define PLUMB_ANGLE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_ANGLE_QUARTER_TURN 0x40000000U
#define PLUMB_ANGLE_HALF_TURN    0x80000000U

/* Direction of the vector (x, y), scale irrelevant: 0 along +x, a quarter turn along +y. (0, 0) gives 0; the
 * direction of -x is -2^31. Error below 5e-6 deg. About 140 cycles of a Cortex-M3. */
int32_t plumb_angle_atan2(int32_t y, int32_t x);

/* Angle whose sine is x / 2^30; beyond +-2^30 it stays at a quarter turn. Error below 7e-6 deg, the ends
 * included. asin(-x) = -asin(x), except that asin(0) is 2 units (1.7e-7 deg). */
int32_t plumb_angle_asin(int32_t x_q30);

/* Sine and cosine, each within +-2^30. Error below 8e-9. */
void plumb_angle_sincos(int32_t turn_q32, int32_t *sin_q30, int32_t *cos_q30);

/* Half the length of the vector (x, y), for |y|, |x| <= 7 * 2^28. Error below 6e-9 of itself and one unit. */
uint32_t plumb_angle_length(int32_t y, int32_t x);

#ifdef __cplusplus
}
#endif

#endif
