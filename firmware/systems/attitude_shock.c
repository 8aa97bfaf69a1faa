#include "attitude_shock.h"
#include "attitude_travel.h"

#define RISE_LIMIT_Q18 157286 /* 0.6 g: no body accelerates downwards so much for seconds */
#define RISE_LEAST_Q18 2621   /* 0.01 g: the cosine of 8 deg; a body that accelerates sideways has none */
#define LEANS_SHIFT    14U    /* 1/16 g in Q18: 3.6 deg */

SELDOM PART void plumb_attitude_note_turn(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const int32_t up_q18 = c->force_before_q18[2];
    int32_t by_q18[2];
    uint32_t turn_q26 = 0;
    for (unsigned i = 0; i < 2U; i++) {
        const int32_t *const turned = c->turned_sum_q28[i];
        const int32_t half_q28 = add_wrap(add_wrap(turned[0], turned[1]), turned[2]);
        by_q18[i] = mulhi_i32(wrap_i32((uint32_t)half_q28 << 5), up_q18);
        turn_q26 += abs_u32(half_q28) >> 2;
    }
    c->turning_rad_q26 += mulhi_near((int32_t)turn_q26 - c->turning_rad_q26, asr32(p->travel_pass_q32, 1));
    const int32_t x_q18 = sub_wrap(sub_wrap(c->force_sum_q18[0], c->force_before_q18[0]), by_q18[1]);
    const int32_t y_q18 = add_wrap(sub_wrap(c->force_sum_q18[1], c->force_before_q18[1]), by_q18[0]);
    const bool held = !c->moved && c->carried_blocks == LANDED_BLOCKS &&
                      turn_q26 > (uint32_t)p->rest_turn >> 11 &&
                      (abs_u32(x_q18) >> 1) + (abs_u32(y_q18) >> 1) <= (uint32_t)p->rest_accel;
    c->held_blocks = (uint8_t)(held ? min_u32(c->held_blocks + 1U, (uint32_t)p->rest_blocks) : 0U);
}

PART bool plumb_attitude_held_still(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    return c->held_blocks == (uint32_t)p->rest_blocks && c->aligned_blocks == RESTED &&
           !plumb_attitude_travels(c) &&
           abs_u32(c->force_before_q18[0]) + abs_u32(c->force_before_q18[1]) > (uint32_t)p->block_steps
                                                                                   << LEANS_SHIFT;
}

PART bool plumb_attitude_lost_in_motion(const plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                        int32_t lasting_q24) {
    const uint32_t explained_q30 = plumb_error_filter_variance(&c->errors, VELOCITY) +
                                   plumb_error_filter_variance(&c->errors, VELOCITY + 1);
    const int32_t over_q24 = lasting_q24 - (int32_t)(explained_q30 >> 6) - asr32(p->travel_least_q24, 1);
    return c->rise_g_q18 > RISE_LIMIT_Q18 ||
           (c->rise_g_q18 > RISE_LEAST_Q18 && c->turning_rad_q26 > asr32(p->rest_turn, 6) && over_q24 > 0);
}
