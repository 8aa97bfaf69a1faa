/* Attitude as a unit quaternion w, x, y, z in Q30. It rotates vectors from the body frame into the frame at
 * the start of the run, and is updated by rotations of the body: q = q * exp(rotation / 2). */
#ifndef PLUMB_QUATERNION_H
#define PLUMB_QUATERNION_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_QUATERNION_ONE 0x40000000 /* 2^30 */

/* Q30, of length 1. */
typedef struct {
    int32_t w, x, y, z;
} plumb_quaternion_t;

/* Rotate q by a rotation vector of the body, turn Q60; each component is clamped to an eighth of a turn. q is
 * normalised. Error below 2e-7 deg up to 0.02 turn, 3e-3 deg at most. */
void plumb_quaternion_rotate(plumb_quaternion_t *q, const int64_t rotation_turn_q60[3]);

/* The rotation that turns `from` into `to`, as a rotation vector of the body, turn Q32. Meant for small
 * rotations: exact to 0.1 % below 8 degrees; the direction is always right. */
void plumb_quaternion_difference(const plumb_quaternion_t *from, const plumb_quaternion_t *to,
                                 int32_t rotation_turn_q32[3]);

#ifdef __cplusplus
}
#endif

#endif
