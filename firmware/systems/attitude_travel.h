/* How `attitude` uses the velocity of a body: whether the body travels or flies, and its velocity by the drag
 * of the rotors. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H
#define PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H

#include "attitude_limits.h"

#define MAYBE_LANDED_BLOCKS PLUMB_ATTITUDE_MAYBE_LANDED_BLOCKS
#define LANDED_BLOCKS       PLUMB_ATTITUDE_LANDED_BLOCKS

/* Square of the lasting velocity, g^2 s^2 Q24; in flight of the lasting difference from the measured one. */
SELDOM PART int32_t plumb_attitude_travel_square(const plumb_attitude_t *c);

/* True when travel explains a lasting velocity. A bias of the gyro then looks the same, so none is learned.
 */
PART bool plumb_attitude_travels(const plumb_attitude_t *c);

/* Square of the lasting velocity above what the covariance and a body that stays in place explain: the body
 * travels. It is held for longer than it is seen, because a velocity that reverses passes zero. */
PART int32_t plumb_attitude_travel_excess(const plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                          int32_t lasting_q24, int32_t hold_q32);

/* The measured velocity at the end of a block: zero on the ground; in flight from the drag of the rotors, v =
 * -a / d with a the mean acceleration across the thrust. The mean is as of the middle of the block, so half
 * of the block's gain is added. At take-off and landing the measurement jumps by up to the speed of the wind;
 * in a block that the ground may carry, neither velocity is known. */
PART void plumb_attitude_measure_velocity(plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                          const int32_t gained[2], int32_t block_s_q32);

#endif
