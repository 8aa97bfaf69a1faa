/* What the step of `wheels` does not believe: an accelerometer that stands still, encoders that are dead, a
 * wheel that slips, and wheels in the air. */
#ifndef PLUMB_SYSTEMS_WHEELS_DOUBT_H
#define PLUMB_SYSTEMS_WHEELS_DOUBT_H

#include "plumb/wheels.h"
#include "systems/parts.h"

#define ROCKED_MOST (1UL << 30) /* turn/s Q28 */

/* Whether the accelerometer of the step before says nothing of the tilt: outside its range, or, while it
 * drives and so is upright, without half of gravity. */
PART_KERNEL bool plumb_wheels_is_odd(const plumb_wheels_words_t *w);

/* Steps in a row, up to the most that is asked for. */
KERNEL uint32_t in_a_row(uint32_t steps, bool again, uint32_t most) {
    return again ? min_u32(steps + 1U, most) : 0U;
}

/* What accelerometer and wheels say of each other, after the step of balancer. The speed that is felt is that
 * of the wheels slowly, and the sum of the acceleration quickly. Encoders turn with the body as well as with
 * the wheels: those that have counted and stand still while the body rocks are dead, as are those that never
 * counted while it moves. Wheels that get nearly the full duty for long, and turn, turn in the air. */
PART_KERNEL uint32_t plumb_wheels_doubt(plumb_wheels_words_t *w, const plumb_wheels_params_t *q, bool on,
                                        int32_t left, int32_t right, int32_t duty_max_q15);

/* Why the motors are off: until it is switched off, for sensors that lie. */
PART_KERNEL uint32_t plumb_wheels_stopped_by(const plumb_wheels_words_t *w, uint32_t flags, bool on,
                                             bool blind);

/* Counts of both wheels in this step. While one slips, those of one of them and of the turn that the gyro
 * feels: of the wheel that is nearer to the speed that the accelerometer has felt; of the one that counts
 * where the other one does not. */
PART_KERNEL int32_t plumb_wheels_both(const plumb_wheels_words_t *w, const plumb_params_t *p, int32_t left,
                                      int32_t right);

#endif
