/* What the velocity of a body tells `attitude`: whether it travels or flies, and what the drag of rotors says
 * of it. Included once, by attitude.c. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H
#define PLUMB_SYSTEMS_ATTITUDE_TRAVEL_H

#include "attitude_limits.h"

#define CARRIED_Q18     209715     /* 0.8 g: without thrust, a body that the ground carries */
#define TAKE_OFF_BLOCKS 4U         /* so many with thrust: it flies */
#define HOLD_Q32        1288490189 /* 0.3: a travel is remembered for 3.3 times the time that shows it */
#define TRAVELS_Q24     16777      /* 0.001 g^2 s^2: a smaller excess is no travel */

/* Square of the velocity, in flight of the difference from the measured one, that has lasted, g^2 s^2 Q24. */
SELDOM int32_t travel_square(const plumb_attitude_t *c) {
    return mulhi_i32(c->travel_gs_q28[0], c->travel_gs_q28[0]) +
           mulhi_i32(c->travel_gs_q28[1], c->travel_gs_q28[1]);
}

/* Whether a lasting velocity is explained by travel. Nothing tells a bias from it then, so that no bias is
 * learned. */
static bool travels(const plumb_attitude_t *c) {
    return c->travel_excess_q24 > TRAVELS_Q24;
}

/* The velocity that has lasted, beyond what the covariance explains and what a body has that stays: the body
 * travels. It is remembered for longer than it is seen, as a velocity that turns passes zero. */
static int32_t travel_excess(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const uint32_t explained_q30 = plumb_error_filter_variance(&c->errors, VELOCITY) +
                                   plumb_error_filter_variance(&c->errors, VELOCITY + 1);
    const int32_t excess = travel_square(c) - (int32_t)(explained_q30 >> 6) - p->travel_least_q24;
    const int32_t held =
        c->travel_excess_q24 - mulhi_near(c->travel_excess_q24, mulhi_i32(p->travel_pass_q32, HOLD_Q32)) - 1;
    return max_i32(max_i32(excess, held), 0);
}

/* Whether the vehicle flies, by its thrust command and what it feels: with thrust for some blocks it has
 * taken off; a body that feels its weight without thrust is carried by the ground. */
static bool flies(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const bool thrust = c->words.thrust_q15 >= p->aid_thrust_q15;
    c->thrust_blocks = (uint8_t)(thrust ? min_u32(c->thrust_blocks + 1U, TAKE_OFF_BLOCKS) : 0U);
    if (thrust)
        return c->airborne || c->thrust_blocks == TAKE_OFF_BLOCKS;
    return c->airborne && mulhi_i32(c->force_sum_q18[2], p->inverse_block_q32) < CARRIED_Q18;
}

/* What is known of the velocity at the end of a block: zero on the ground; in flight that of the drag of the
 * rotors, v = -a / d with a the mean acceleration across the thrust, and half of what the block has gained,
 * as the mean is as old as that. A change is a jump of up to the wind. */
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
        c->measured_gs_q28[i] = airborne ? clamp_i32(saturated((int64_t)drag_gs + asr32(gained[i], 1)),
                                                     -VELOCITY_LIMIT_Q28, VELOCITY_LIMIT_Q28)
                                         : 0;
    }
}

#endif
