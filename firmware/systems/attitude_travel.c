#include "attitude_travel.h"

#define TRAVELS_Q24      16777     /* 0.001 g^2 s^2: a smaller excess is no travel */
#define FORCE_MOST_Q18   (4 << 18) /* 4 g: a larger mean acceleration of a block counts as that */
#define WEIGHT_LEAST_Q16 53084U    /* (0.9 g)^2 */
#define WEIGHT_MOST_Q16  79299U    /* (1.1 g)^2 */
#define FALLS_Q16        16384U    /* (0.5 g)^2 */
#define HOVER_MOST_Q16   1048575U  /* (4 g)^2 */
#define HOVER_LOW_Q15    3277      /* 0.1: thrust to weight below 20 */
#define HOVER_HIGH_Q15   27853     /* 0.85 */
#define THRUST_MOST_Q15  31130     /* 0.95: above it the rotors are near their limit */
#define THIRD_Q32        1431655765
#define LIFTS_GS_Q28     8053064U /* 0.03 g s, 0.3 m/s */
#define TAKE_OFF_BLOCKS  4U
#define FIRST_BLOCKS     16U

SELDOM PART int32_t plumb_attitude_travel_square(const plumb_attitude_t *c) {
    return mulhi_i32(c->travel_gs_q28[0], c->travel_gs_q28[0]) +
           mulhi_i32(c->travel_gs_q28[1], c->travel_gs_q28[1]);
}

PART bool plumb_attitude_travels(const plumb_attitude_t *c) {
    return c->travel_excess_q24 > TRAVELS_Q24;
}

PART int32_t plumb_attitude_travel_excess(const plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                          int32_t lasting_q24, int32_t hold_q32) {
    const uint32_t explained_q30 = plumb_error_filter_variance(&c->errors, VELOCITY) +
                                   plumb_error_filter_variance(&c->errors, VELOCITY + 1);
    const int32_t excess = lasting_q24 - (int32_t)(explained_q30 >> 6) - p->travel_least_q24;
    const int32_t held = c->travel_excess_q24 - mulhi_near(c->travel_excess_q24, hold_q32) - 1;
    return max_i32(max_i32(excess, held), 0);
}

/* Square of the length of a mean acceleration, g^2 Q16, components limited to 4 g. */
SELDOM static uint32_t square_g2_q16(const int32_t mean_g_q18[3]) {
    uint32_t square = 0;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t g_q24 = 64 * clamp_i32(mean_g_q18[i], -FORCE_MOST_Q18, FORCE_MOST_Q18);
        square += (uint32_t)mulhi_i32(g_q24, g_q24);
    }
    return square;
}

/* x^(-1/3), Q14 of Q16, for 1/4 <= x < 16: two Newton steps y (4 - x y^3) / 3 from 0.9 * 2^(-n/3), n the
 * exponent of x; within 0.5 %. */
SELDOM static int32_t inverse_cube_root_q14(uint32_t x_q16) {
    static const uint16_t start_q14[6] = {23407U, 18578U, 14746U, 11704U, 9289U, 7373U};
    uint32_t y = start_q14[17U - clz32(x_q16)];
    for (unsigned i = 0; i < 2U; i++) {
        const uint32_t cube_q14 = ((y * y >> 14) * y) >> 14;
        y = mulhi_u32(y * ((4U << 14) - (x_q16 * cube_q14 >> 16)), THIRD_Q32) >> 14;
    }
    return (int32_t)y;
}

/* Learns the thrust command of a hover from a block in flight. The thrust of a rotor grows with about the
 * power 1.5 of its command, so a block with the acceleration f g shows a hover at thrust * f^(-2/3). Blocks
 * below 0.5 or above 4 g and commands near the limit of the rotors are left out. In the first two seconds of
 * a flight it learns fast. */
static void learn_hover(plumb_attitude_t *c, int32_t thrust_q15, uint32_t square) {
    if (square < FALLS_Q16 || square > HOVER_MOST_Q16 || thrust_q15 > THRUST_MOST_Q15) {
        return;
    }
    const int32_t at_1_g = asr32(thrust_q15 * inverse_cube_root_q14(square), 14);
    const int32_t off = at_1_g - c->hover_q15;
    const unsigned shift = c->flown_blocks < FIRST_BLOCKS ? 2U : off < 0 ? 5U : 4U;
    const int32_t by = asr32(off + 2, shift);
    c->hover_q15 = clamp_i32(c->hover_q15 + by, HOVER_LOW_Q15, HOVER_HIGH_Q15);
}

/* Follows take-off and landing, once a block.
 *
 * A vehicle that has landed takes off when it rises or sinks by more than 0.3 m/s, or after four blocks with
 * 7/8 of the thrust of a hover, where that is known. In flight it is carried while it feels its weight, 0.9
 * to 1.1 g in any direction, with a thrust well below that of a hover. A vehicle that falls at its terminal
 * speed feels its weight, too: eight carried blocks in a row are a landing that may be none, and only 67 are
 * one; with the rotors off eight are enough. A block that ends at a limit of the accelerometer tells neither
 * a weight nor a hover: an acceleration of 1 g may stand in for what is not known. */
SELDOM static void follow_flight(plumb_attitude_t *c, const plumb_attitude_params_t *p, int32_t block_s_q32) {
    int32_t mean_g_q18[3];
    for (unsigned i = 0; i < 3U; i++) {
        mean_g_q18[i] = mulhi_i32(c->force_sum_q18[i], p->inverse_block_q32);
    }
    const uint32_t square = square_g2_q16(mean_g_q18);
    const int32_t thrust = clamp_i32(c->words.thrust_q15, 0, INT16_MAX), hover = c->hover_q15;
    const int32_t lifted =
        clamp_i32(sub_wrap(mean_g_q18[2], c->weight_g_q18), -FORCE_MOST_Q18, FORCE_MOST_Q18);
    const bool felt = c->accel_clipped_steps == 0U;
    const bool weighs = felt && square >= WEIGHT_LEAST_Q16 && square <= WEIGHT_MOST_Q16;

    c->climb_gs_q28 += mulhi_i32(lifted * 1024, block_s_q32) - asr32(c->climb_gs_q28, 5);
    c->climb_gs_q28 = VELOCITY_SATURATED(c->climb_gs_q28);
    if (c->carried_blocks == LANDED_BLOCKS) {
        if (weighs) {
            c->weight_g_q18 += asr32(lifted, 5);
        }
        if (thrust == 0) {
            c->climb_gs_q28 = 0;
        }
        const bool hovers = hover != 0 && 8 * thrust >= 7 * hover;
        c->thrust_blocks = (uint8_t)(hovers ? min_u32(c->thrust_blocks + 1U, TAKE_OFF_BLOCKS) : 0U);
        if (thrust != 0 && (c->thrust_blocks == TAKE_OFF_BLOCKS || abs_u32(c->climb_gs_q28) > LIFTS_GS_Q28)) {
            c->carried_blocks = c->flown_blocks = c->thrust_blocks = 0;
            /* a vehicle that rises has at least the thrust of a hover */
            if (hover == 0 || (c->climb_gs_q28 > 0 && thrust < hover)) {
                c->hover_q15 = clamp_i32(thrust, HOVER_LOW_Q15, HOVER_HIGH_Q15);
            }
        }
        return;
    }
    c->flown_blocks = (uint8_t)min_u32(c->flown_blocks + 1U, UINT8_MAX);
    if (weighs && 4 * thrust < 3 * hover) {
        c->carried_blocks++;
        if (thrust == 0 && c->carried_blocks >= MAYBE_LANDED_BLOCKS) {
            c->carried_blocks = LANDED_BLOCKS;
        }
    } else {
        c->carried_blocks = 0;
    }
    if (c->carried_blocks >= MAYBE_LANDED_BLOCKS) {
        c->climb_gs_q28 = 0;
    }
    const bool lifts = 4 * thrust >= 3 * hover || (c->flown_blocks < FIRST_BLOCKS && 8 * thrust >= 3 * hover);
    if (felt && lifts) {
        learn_hover(c, thrust, square);
    }
}

PART void plumb_attitude_measure_velocity(plumb_attitude_t *c, const plumb_attitude_params_t *p,
                                          const int32_t gained[2], int32_t block_s_q32) {
    follow_flight(c, p, block_s_q32);
    if (p->aid_s_q24 == 0) {
        return;
    }
    const bool airborne = c->carried_blocks < MAYBE_LANDED_BLOCKS;
    if (airborne != c->airborne) {
        c->travel_gs_q28[0] = c->travel_gs_q28[1] = 0;
    }
    if (airborne != c->airborne || (airborne && c->carried_blocks != 0U)) {
        plumb_attitude_add_limited(&c->velocity_added_q26, VELOCITY_ADDED_Q26, VELOCITY_ADDED_Q26);
    }
    c->airborne = airborne;
    for (unsigned i = 0; i < 2U; i++) {
        const int32_t across_q18 =
            mulhi_i32(sub_wrap(c->force_sum_q18[i], c->thrust_sum_q18[i]), p->inverse_block_q32);
        const int32_t drag_gs = plumb_attitude_saturated(asr64(mul_i64(-across_q18, p->aid_s_q24), 14));
        const int32_t at_end_gs = plumb_attitude_saturated((int64_t)drag_gs + asr32(gained[i], 1));
        c->measured_gs_q28[i] = airborne ? VELOCITY_SATURATED(at_end_gs) : 0;
    }
}
