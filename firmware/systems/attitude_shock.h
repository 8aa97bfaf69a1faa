/* How `attitude` notices that the bias of the gyro has stepped. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_SHOCK_H
#define PLUMB_SYSTEMS_ATTITUDE_SHOCK_H

#include "attitude_limits.h"

#define RESTED 5U /* aligned_blocks after the first rest */

/* Notes how the last block has turned about horizontal axes: the mean of seconds; and whether it was held, so
 * that the gyro alone has turned: rates are steady, and the acceleration stays where it was in the body's
 * axes.
 */
SELDOM PART void plumb_attitude_note_turn(plumb_attitude_t *c, const plumb_attitude_params_t *p);

/* True when the gyro alone has turned for as long as a rest takes, although its bias was known, and the
 * acceleration leans. */
PART bool plumb_attitude_held_still(const plumb_attitude_t *c, const plumb_attitude_params_t *p);

/* True when the vertical is lost in motion: the vertical acceleration is too small for seconds; or a body
 * that turns about horizontal axes, and so does not drive, has a lasting velocity, and its acceleration
 * leans. */
PART bool plumb_attitude_lost_in_motion(const plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                        int32_t lasting_q24);

#endif
