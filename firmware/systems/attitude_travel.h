/* How `attitude` uses the velocity of a body: whether the body travels or flies, and its velocity by the drag
 * of the rotors. Included once, by attitude.c. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H
#define PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H

#include "attitude_limits.h"

#define CARRIED_Q18     209715     /* 0.8 g: above it without thrust, the ground carries the body */
#define TAKE_OFF_BLOCKS 4U         /* after this many blocks with thrust it flies */
#define HOLD_Q32        1288490189 /* 0.3: a travel is held for 3.3 times the time constant that detects it */
#define TRAVELS_Q24     16777      /* 0.001 g^2 s^2: a smaller excess is no travel */

/* Square of the lasting velocity, g^2 s^2 Q24; in flight of the lasting difference from the measured one. */
SELDOM int32_t travel_square(const plumb_attitude_t *c) {
    return mulhi_i32(c->travel_gs_q28[0], c->travel_gs_q28[0]) +
           mulhi_i32(c->travel_gs_q28[1], c->travel_gs_q28[1]);
}

/* True when travel explains a lasting velocity. A bias of the gyro then looks the same, so none is learned.
 */
static bool travels(const plumb_attitude_t *c) {
    return c->travel_excess_q24 > TRAVELS_Q24;
}

/* Square of the lasting velocity above what the covariance and a body that stays in place explain: the body
 * travels. It is held for longer than it is seen, because a velocity that reverses passes zero. */
static int32_t travel_excess(const plumb_attitude_t *c, const plumb_attitude_params_t *p, int32_t lasting_q24,
                             int32_t hold_q32) {
    const uint32_t explained_q30 = plumb_error_filter_variance(&c->errors, VELOCITY) +
                                   plumb_error_filter_variance(&c->errors, VELOCITY + 1);
    const int32_t excess = lasting_q24 - (int32_t)(explained_q30 >> 6) - p->travel_least_q24;
    const int32_t held = c->travel_excess_q24 - mulhi_near(c->travel_excess_q24, hold_q32) - 1;
    return max_i32(max_i32(excess, held), 0);
}

/* True while the vehicle flies, by its thrust command and its acceleration: after some blocks with thrust it
 * has taken off; without thrust, a body that measures its weight is carried by the ground. */
static bool flies(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const bool thrust = c->words.thrust_q15 >= p->aid_thrust_q15;
    c->thrust_blocks = (uint8_t)(thrust ? min_u32(c->thrust_blocks + 1U, TAKE_OFF_BLOCKS) : 0U);
    if (thrust)
        return c->airborne || c->thrust_blocks == TAKE_OFF_BLOCKS;
    return c->airborne && mulhi_i32(c->force_sum_q18[2], p->inverse_block_q32) < CARRIED_Q18;
}

/* The measured velocity at the end of a block: zero on the ground; in flight from the drag of the rotors, v =
 * -a / d with a the mean acceleration across the thrust. The mean is as of the middle of the block, so half
 * of the block's gain is added. At take-off and landing the measurement jumps by up to the speed of the wind.
 */
static void measure_velocity(plumb_attitude_t *c, const plumb_attitude_params_t *p, const int32_t gained[2]) {
    const bool airborne = flies(c, p);
    if (airborne != c->airborne) {
        add_limited(&c->velocity_added_q26, VELOCITY_ADDED_Q26, VELOCITY_ADDED_Q26);
        c->travel_gs_q28[0] = c->travel_gs_q28[1] = 0;
    }
    c->airborne = airborne;
    for (unsigned i = 0; i < 2U; i++) {
        const int32_t across_q18 =
            mulhi_i32(sub_wrap(c->force_sum_q18[i], c->thrust_sum_q18[i]), p->inverse_block_q32);
        const int32_t drag_gs = saturated(asr64(mul_i64(-across_q18, p->aid_s_q24), 14));
        const int32_t at_end_gs = saturated((int64_t)drag_gs + asr32(gained[i], 1));
        c->measured_gs_q28[i] = airborne ? VELOCITY_SATURATED(at_end_gs) : 0;
    }
}

#endif
