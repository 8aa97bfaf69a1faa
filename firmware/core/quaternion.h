/* Attitude as a unit quaternion w, x, y, z in Q30: it turns vectors of the body frame into the frame of the
 * start, and grows by rotations of the body: q = q * exp(rotation / 2). */
#ifndef PLUMB_CORE_QUATERNION_H
#define PLUMB_CORE_QUATERNION_H

#include "fixed.h"

#define QUATERNION_ONE 0x40000000 /* 2^30 */

typedef struct {
    int32_t w, x, y, z;
} quaternion_t;

/* q turned by a rotation vector of the body, turn Q60; each component counts up to an eighth of a turn. The
 * length is kept at 1. Error below 2e-7 deg up to 0.02 turn, 3e-3 deg at most. */
void quaternion_rotate(quaternion_t *q, const int64_t rotation_turn_q60[3]);

/* The small rotation that turns `from` into `to`, as a rotation vector of the body, turn Q32; right to 0.1 %
 * below 8 degrees, and of the right direction always. */
void quaternion_difference(const quaternion_t *from, const quaternion_t *to, int32_t rotation_turn_q32[3]);

#endif
