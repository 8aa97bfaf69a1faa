/* How the quaternion of `attitude` turns: about the earth's axes, about the body's, to the vertical. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_TURNS_H
#define PLUMB_SYSTEMS_ATTITUDE_TURNS_H

#include "attitude_limits.h"

/* Turn the earth's side of the attitude: (w, x, y, 0) * q, all Q30, then a first-order normalisation. */
SELDOM PART void plumb_attitude_turn_earth(plumb_quaternion_t *q, int32_t w, int32_t x, int32_t y);

/* Turn the attitude so that the acceleration (x, y, z), in earth axes, points up; components below 2^30.
 * Returns half its length; below `least` nothing is turned. */
SELDOM PART uint32_t plumb_attitude_align(plumb_quaternion_t *q, int32_t x, int32_t y, int32_t z,
                                          uint32_t least);

/* Turn an acceleration in earth axes by the small angle of a correction of the attitude: the check for rest
 * must not take the correction for a motion. */
SELDOM PART void plumb_attitude_turn_force(int32_t force[3], int32_t x_q32, int32_t y_q32);

/* Turn the attitude by half angles (rad Q32, within 1/2 each) about body axes. Returns their square, Q30.
 * sin(h) / h = 1 - h^2/6 (1 - h^2/20 (1 - h^2/42)), cos(h) = 1 - h^2/2 (1 - h^2/12 (1 - h^2/30)) */
SHARED PART uint32_t plumb_attitude_turn_body(plumb_quaternion_t *q, int32_t hx, int32_t hy, int32_t hz);

/* Rows of the attitude's matrix, Q30: from body to earth. */
SHARED PART void plumb_attitude_matrix_of(const plumb_quaternion_t *q, int32_t m[9]);

#endif
