/* Angles from ratios and ratios from angles, as binary angles: int32, a full turn is 2^32. About 140 cycles
 * an angle; atan2 and sincos take a constant number of instructions. */
#ifndef PLUMB_CORE_ANGLE_H
#define PLUMB_CORE_ANGLE_H

#include <stdint.h>

/* Direction of the vector (x, y), any int32, scale irrelevant: 0 along +x, a quarter turn along +y. (0, 0)
 * gives 0; the direction of -x is -2^31, which is the half turn. Error below 5e-6 deg. */
int32_t angle_atan2(int32_t y, int32_t x);

/* Angle whose sine is x / 2^30; beyond +-2^30 it stays at a quarter turn. asin(-x) = -asin(x) but at 0,
 * which gives 2 units (1.7e-7 deg). Error below 7e-6 deg everywhere, the ends included. */
int32_t angle_asin(int32_t x_q30);

/* Sine and cosine of any angle, each within +-2^30. Error below 8e-9. */
void angle_sincos(int32_t turn_q32, int32_t *sin_q30, int32_t *cos_q30);

/* Half the length of the vector (x, y), for |y|, |x| <= 7 * 2^28 (the half, so that it is an int32 as well).
 * Error below 6e-9 of itself and one unit. */
uint32_t angle_length(int32_t y, int32_t x);

#endif
