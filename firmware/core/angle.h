/* Inverse trigonometry in binary angles: a full turn is 2^32. `plumb bench` measures cost and error. */
#ifndef PLUMB_CORE_ANGLE_H
#define PLUMB_CORE_ANGLE_H

#include <stdint.h>

/* Angle of the point (x, y), any two int32 in the same unit; atan2(0, 0) is 0. Constant number of
 * instructions. */
int32_t angle_atan2(int32_t y, int32_t x);

/* Arcsine of a Q26 number; outside [-1, 1] the result is a quarter turn of the same sign. */
int32_t angle_asin(int32_t sine_q26);

#endif
