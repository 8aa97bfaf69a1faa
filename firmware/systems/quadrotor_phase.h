/* The phase of a quadrotor, from the receiver's frames and from conditions that last. */
#ifndef PLUMB_SYSTEMS_QUADROTOR_PHASE_H
#define PLUMB_SYSTEMS_QUADROTOR_PHASE_H

#include "plumb/quadrotor.h"
#include "systems/parts.h"

#define STEPS_MOST     65535U
#define WATCHED_BLOCKS 8U /* after the take-off a runaway stops the rotors for so long, about 1 s */
#define TOUCHED_BLOCKS 2U /* carried for so long: the integrals stay */

/* Steps for which a condition has been met without a break. */
KERNEL void count(uint32_t *steps, bool met) {
    *steps = met ? min_u32(*steps + 1U, STEPS_MOST) : 0U;
}

/* True while the receiver is lost. */
PART_KERNEL bool plumb_quadrotor_listen(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                        int32_t receiver);

/* True when the vehicle lies on its side or back at rest, 60 deg or more off level: after a crash. */
PART_KERNEL bool plumb_quadrotor_lies(const plumb_quadrotor_words_t *w, const int32_t accel_g_q25[3]);

/* Counts the steps of a runaway: rotors in the wrong places and an inverted gyro drive a rate away from what
 * is asked for, while the mixer gives all it has. With a low throttle it has nothing to give, and wind turns
 * a vehicle, too. Steps of other kinds are taken off again. */
PART_KERNEL void plumb_quadrotor_watch_runaway(plumb_quadrotor_words_t *w, bool low, bool watched);

/* Sets the phase and the reason of a stop. on: the switch of the rotors. */
PART_KERNEL void plumb_quadrotor_decide(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                        bool on, bool lost, bool landed, bool unsure);

/* Sets the throttle of the phase. A landing holds a speed of descent once a block: proportional 1.5 and
 * integral 1.5 per s of the thrust of a hover by g s, about 0.7 s to follow; while the ground may carry the
 * vehicle its throttle ends within half a second. One that stands on the ground when its landing begins does
 * not rise. */
PART_KERNEL void plumb_quadrotor_set_throttle(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                              int32_t given_q15, bool block_ends);

#endif
