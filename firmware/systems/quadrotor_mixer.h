/* The rates that the sticks and the error of the vertical demand, and the mixer of an X frame. */
#ifndef PLUMB_SYSTEMS_QUADROTOR_MIXER_H
#define PLUMB_SYSTEMS_QUADROTOR_MIXER_H

#include "plumb/quadrotor.h"
#include "systems/parts.h"

/* The rates that the sticks of roll, pitch and yaw, Q15, demand. levels: roll and pitch demand an angle,
 * whose error asks for at most rate_max. */
PART_KERNEL void plumb_quadrotor_ask(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                     const int32_t sticks[3], bool levels, int32_t rate_max_q28);

/* Computes the four commands of flying rotors; returns the flags of the commands that were limited. free: the
 * thrust may rise above the throttle. */
PART_KERNEL uint32_t plumb_quadrotor_mix(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                         const plumb_esc_params_t *esc, bool free);

/* Sets the commands of stopped rotors. */
PART_KERNEL void plumb_quadrotor_rest(plumb_quadrotor_words_t *w, const plumb_esc_params_t *esc);

#endif
