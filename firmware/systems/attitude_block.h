/* The end of a block of `attitude`, and its computations in the steps of the next block, one slice a step:
 * correction, judgement, growth and measurements. Included once, by attitude.c. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_BLOCK_H
#define PLUMB_SYSTEMS_ATTITUDE_BLOCK_H

#include "attitude_shock.h"

#define TWO_BY_PI_Q31       1367130551 /* normalised bias (rad/s times 4) Q28 to turn/s Q32 */
#define BIAS_LIMIT_Q32      (1 << 30)  /* 90 deg/s */
#define SCALE_LIMIT_Q32     (1 << 28)
#define SPEED_LIMIT_Q26     INT32_MAX /* 32 g^2 s^2: largest variance of a measured velocity */
#define TILT_STEP_LIMIT_Q28 (1 << 26) /* largest correction of the tilt in a block, rad */
#define ALIGNING_BLOCKS     4U
#define LEAST_REST_Q16      62300U     /* 0.975^2 g^2: the acceleration of a body at rest */
#define MOST_REST_Q16       68853U     /* 1.025^2 g^2 */
#define TILTED_Q24          15099494   /* 0.9 g: the cosine of 26 deg */
#define LONG_RESTS          7U         /* rests in a row that a steady acceleration does not last */
#define MOST_BY_TURN        (1 << 30)  /* growth of the tilt's variance by the square of a turn, Q32 */
#define RESTING_SQUARE_Q24  104857600  /* (2.5 g s)^2: a body at rest is not as fast as 25 m/s */
#define MOST_LASTING_Q24    (1U << 23) /* (0.7 g s)^2: in flight, 20 deg of stated tilt */
#define FLIGHT_LEAST_Q32    2943711U   /* (1.5 deg)^2: what a step of the gyro's bias makes before it shows */
#define JUDGED              (PLUMB_ATTITUDE_FLAG_UNSURE | PLUMB_ATTITUDE_FLAG_ACCELERATING)

/* The slice of the last block that a step computes. Each measurement takes two slices: velocity x, y, and at
 * rest also bias x, y, z. The first slice of the first measurement also completes the growth. */
enum { SLICE_NONE, SLICE_CORRECT, SLICE_JUDGE, SLICE_TILT_X, SLICE_TILT_Y, SLICE_MEASURE };

/* Clears the sums at the start of a block. */
static void clear_sums(plumb_attitude_t *c) {
    for (unsigned j = 0; j < 3U; j++) {
        c->rows_sum_q22[0][j] = c->rows_sum_q22[1][j] = 0;
        c->turned_sum_q28[0][j] = c->turned_sum_q28[1][j] = 0;
        c->force_sum_q18[j] = c->half_sum_q32[j] = 0;
    }
    c->tilt_added_q32 = c->velocity_added_q26 = 0;
    c->energy_q24 = 0;
    c->thrust_sum_q18[0] = c->thrust_sum_q18[1] = 0;
    c->moved = false;
}

/* Forgets the velocity, and how well the errors are known: their variances become those of a start, of bias
 * and tilt these. */
SELDOM void forget(plumb_attitude_t *c, const plumb_attitude_params_t *a, int32_t bias, int32_t tilt) {
    plumb_attitude_words_t *const w = &c->words;
    w->velocity_gs_q28[0] = w->velocity_gs_q28[1] = 0;
    w->velocity_square_g2s2_q24 = 0;
    plumb_error_filter_start(&c->errors, bias, a->start_scale, tilt, a->start_speed);
    w->tilt_variance_rad2_q32 = 2U * (uint32_t)a->start_tilt;
    c->block_flags |= PLUMB_ATTITUDE_FLAG_UNSURE;
    c->held_blocks = 0;
    c->travel_gs_q28[0] = c->travel_gs_q28[1] = 0;
    c->travel_excess_q24 = c->rise_g_q18 = 0;
    c->corrected_rad_q26[0] = c->corrected_rad_q26[1] = 0;
}

/* Restarts the filter as before the first sample; the heading stays. */
SELDOM void start(plumb_attitude_t *c, const plumb_attitude_params_t *a) {
    for (unsigned i = 0; i < 3U; i++) {
        c->words.bias_turnps_q32[i] = c->words.scale_q32[i] = 0;
    }
    c->block_flags = PLUMB_ATTITUDE_FLAG_ALIGNING;
    forget(c, a, a->start_bias, a->start_tilt);
    c->slice = SLICE_NONE;
    c->still_blocks = c->aligned_blocks = 0;
    clear_sums(c);
}

/* Applies the corrections of the block before the last one, propagated over the last block, to the state. */
SELDOM void correct(plumb_attitude_t *c) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t *const by = c->errors.correction_q28;

    plumb_error_filter_predict(&c->errors);
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t bias = (int32_t)asr64(mul_i64(by[BIAS + i], TWO_BY_PI_Q31) + (1 << 30), 31);
        /* Bias and correction may both be at the limit: their sum does not fit into 32 bits. */
        const int32_t now = w->bias_turnps_q32[i];
        const int32_t down = -BIAS_LIMIT_Q32 - (now < 0 ? now : 0), up = BIAS_LIMIT_Q32 - (now > 0 ? now : 0);
        w->bias_turnps_q32[i] = now + clamp_i32(bias, down, up);
        w->scale_q32[i] =
            clamp_i32(w->scale_q32[i] + asr32(by[SCALE + i], 2), -SCALE_LIMIT_Q32, SCALE_LIMIT_Q32);
    }
    const int32_t x = clamp_i32(by[TILT], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28);
    const int32_t y = clamp_i32(by[TILT + 1], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28);
    turn_earth(&w->attitude, ONE_Q30, 2 * x, 2 * y);
    turn_force(c->force_before_q18, 16 * x, 16 * y);
    for (unsigned i = 0; i < 2U; i++) {
        w->velocity_gs_q28[i] = saturated(w->velocity_gs_q28[i] + 2 * (int64_t)by[VELOCITY + i]);
    }
}

/* True for an acceleration of 1 g, within 2.5 %, that is 26 deg or more off the vertical. A body that has
 * taken one horizontal acceleration for the vertical, and then feels the opposite one, measures at
 * least 1.026 g at that angle, so the attitude is wrong when the body rests. */
static bool tilted_at_rest(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    uint32_t square_q16 = 0;
    int32_t mean_g_q24 = 0;
    for (unsigned i = 0; i < 3U; i++) {
        mean_g_q24 = wrap_i32((uint32_t)mulhi_i32(c->force_before_q18[i], p->inverse_block_q32) << 6);
        square_q16 += (uint32_t)mulhi_i32(mean_g_q24, mean_g_q24);
    }
    return square_q16 > LEAST_REST_Q16 && square_q16 < MOST_REST_Q16 && mean_g_q24 < TILTED_Q24;
}

/* Propagates the covariance of the velocity for the first time; unless the vertical is lost. A body that
 * rests starts the filter again; one that moves, or whose gyro alone has turned, keeps its attitude and its
 * bias, of which nothing is known any more. */
static void doubt(plumb_attitude_t *c, const plumb_attitude_params_t *p, int32_t square_q24,
                  int32_t lasting_q24) {
    const int32_t up_g_q18 = mulhi_i32(c->force_before_q18[2], p->inverse_block_q32);
    const int32_t risen_g_q18 = mulhi_near((1 << 18) - up_g_q18 - c->rise_g_q18, p->travel_pass_q32);
    const bool landed = c->carried_blocks == LANDED_BLOCKS;
    c->rise_g_q18 = landed ? c->rise_g_q18 + risen_g_q18 : 0;
    const bool held = held_still(c, p);
    if (landed && (c->block_flags & PLUMB_ATTITUDE_FLAG_REST) != 0U &&
        (tilted_at_rest(c, p) ||
         (c->still_blocks == LONG_RESTS * (uint32_t)p->rest_blocks && square_q24 > RESTING_SQUARE_Q24))) {
        start(c, p);
        c->block_flags |= PLUMB_ATTITUDE_FLAG_RESTARTED;
    } else if (held || lost_in_motion(c, p, lasting_q24)) {
        const uint32_t bias = min_u32((uint32_t)p->start_bias, VARIANCE_LIMIT_Q32 / 4U) * 4U;
        forget(c, p, (int32_t)bias, asr32(p->start_tilt, 3));
        if (held) {
            c->block_flags |= PLUMB_ATTITUDE_FLAG_REST;
        }
    } else {
        plumb_error_filter_grow_velocity(&c->errors);
    }
}

/* Judges the velocity of a block: how far it may be taken for zero, and whether the attitude is lost.
 *
 * The stated variance has three parts. 3/16 of the filter's own: the filter expects a body to be faster than
 * most are. On the ground 3/2 of the square of the tilt that was corrected in one direction within 10 s, at
 * most 6 times the filter's own: such corrections show an error that the filter does not expect. And the
 * square of the tilt that would sustain the lasting velocity: in flight v / 2 s, because the filter follows
 * the drag in 2 s; else v / 128 s, less than the leak of the velocity. In flight, where nothing shows the
 * vertical for seconds, there are three more: the least; the square of the tilt of the newest difference of
 * the velocities, by v / 2.8 s; and no block takes more than an eighth away. */
SELDOM void judge(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t hold_q32 = any_i32(mulhi_i32(p->travel_pass_q32, HOLD_Q32));
    int32_t square_q24 = 0, off_square_q24 = 0;
    uint32_t corrected_q20 = 0;
    for (unsigned i = 0; i < 2U; i++) {
        const int32_t v = VELOCITY_SATURATED(w->velocity_gs_q28[i]);
        w->velocity_gs_q28[i] = c->airborne ? v : v - mulhi_near(v, p->leak_q32);
        square_q24 += mulhi_i32(w->velocity_gs_q28[i], w->velocity_gs_q28[i]);
        const int32_t off = VELOCITY_SATURATED(w->velocity_gs_q28[i] - c->measured_gs_q28[i]);
        off_square_q24 += mulhi_i32(off, off);
        c->travel_gs_q28[i] += mulhi_near(off - c->travel_gs_q28[i], p->travel_pass_q32);
        const int32_t kept = c->corrected_rad_q26[i] - mulhi_i32(c->corrected_rad_q26[i], hold_q32);
        c->corrected_rad_q26[i] = SATURATE(kept + asr32(c->errors.correction_q28[TILT + i], 2), 26);
        corrected_q20 += (uint32_t)mulhi_i32(c->corrected_rad_q26[i], c->corrected_rad_q26[i]);
    }
    const int32_t lasting_q24 = travel_square(c);
    w->velocity_square_g2s2_q24 += mulhi_near(square_q24 - w->velocity_square_g2s2_q24, p->velocity_pass_q32);
    c->travel_excess_q24 = c->airborne ? 0 : travel_excess(c, p, lasting_q24, hold_q32);
    const int64_t moving = asr64(mul_i64(w->velocity_square_g2s2_q24, p->velocity_share_q16) +
                                     mul_i64(c->travel_excess_q24, p->travel_gain_q16),
                                 14);
    const int32_t room = SPEED_LIMIT_Q26 - p->speed_min;
    w->velocity_variance_g2s2_q26 =
        c->airborne ? (uint32_t)p->aid_variance
                    : (uint32_t)p->speed_min + (uint32_t)(moving < room ? (int32_t)moving : room);

    const uint32_t filter_q32 =
        plumb_error_filter_variance(&c->errors, TILT) + plumb_error_filter_variance(&c->errors, TILT + 1);
    if (p->aid_s_q24 != 0 && c->carried_blocks != LANDED_BLOCKS) {
        const uint32_t now_q32 = FLIGHT_LEAST_Q32 + 3U * (filter_q32 >> 4) +
                                 (min_u32((uint32_t)lasting_q24, MOST_LASTING_Q24) << 6) +
                                 (min_u32((uint32_t)off_square_q24, MOST_LASTING_Q24) << 5);
        const uint32_t before_q32 = w->tilt_variance_rad2_q32;
        w->tilt_variance_rad2_q32 = max_u32(now_q32, before_q32 - (before_q32 >> 3));
    } else {
        const uint32_t shown_q20 = min_u32(corrected_q20, filter_q32 >> 10);
        w->tilt_variance_rad2_q32 =
            3U * ((filter_q32 >> 4) + (shown_q20 << 11)) + ((uint32_t)lasting_q24 >> 6);
    }
    const bool unsure = w->tilt_variance_rad2_q32 > p->unsure;
    const bool accelerating = w->velocity_variance_g2s2_q26 > 4U * (uint32_t)p->speed_min;
    c->block_flags = (c->block_flags & ~(uint32_t)JUDGED) | (unsure ? PLUMB_ATTITUDE_FLAG_UNSURE : 0U) |
                     (accelerating ? PLUMB_ATTITUDE_FLAG_ACCELERATING : 0U);
    doubt(c, p, square_q24, lasting_q24);
}

/* Computes one slice of the last block. Returns true when it has turned the attitude. */
SHARED bool compute_slice(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const unsigned slice = c->slice;
    const unsigned measured = (c->block_flags & PLUMB_ATTITUDE_FLAG_REST) != 0U ? 5U : 2U;
    const bool last = slice + 1U == SLICE_MEASURE + 2U * measured;
    c->slice = (uint8_t)(last ? SLICE_NONE : slice + 1U);
    if (slice == SLICE_CORRECT) {
        correct(c);
        return true;
    }
    if (slice == SLICE_JUDGE) {
        judge(c, p);
    } else if (slice < SLICE_MEASURE) {
        plumb_error_filter_grow_tilt(&c->errors, slice - SLICE_TILT_X);
    } else if ((slice - SLICE_MEASURE) % 2U != 0U) {
        plumb_error_filter_shrink(&c->errors);
    } else {
        const unsigned number = (slice - SLICE_MEASURE) / 2U;
        if (number == 0U) {
            plumb_error_filter_grow(&c->errors, travels(c) ? 0 : p->q_bias, p->q_scale);
        }
        if (number < 2U) {
            plumb_error_filter_weigh(
                &c->errors, VELOCITY + number, (uint64_t)c->words.velocity_variance_g2s2_q26 << 4,
                asr32(sub_wrap(c->measured_gs_q28[number], c->words.velocity_gs_q28[number]), 1));
        } else {
            plumb_error_filter_weigh(
                &c->errors, BIAS + number - 2U, (uint32_t)p->rest_variance,
                saturated(asr64(mul_i64(c->half_mean_q32[number - 2U], p->rest_gain_q20), 20)));
        }
    }
    return false;
}

/* Velocity that a block has gained, g s Q28. */
SELDOM int32_t gained(int32_t force_sum_q18, int32_t dt_s_q33) {
    return saturated(asr64(mul_i64(force_sum_q18, dt_s_q33), 23));
}

/* Growth of the tilt's variance in a block, rad^2 Q32. A lasting velocity above that of a body that moves
 * little shows that turns are measured worse than the parameters expect, unless the body travels or flies. */
static int32_t tilt_growth(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const int32_t lasting_q24 = max_i32(travel_square(c) - (p->speed_min >> 2), 0);
    const int64_t doubt = travels(c) || c->airborne ? 0 : asr64(mul_i64(lasting_q24, p->doubt_q24), 16);
    const int64_t by_turn = p->q_turn_q24 + doubt;
    const int64_t turned =
        asr64(mul_i64((int32_t)c->energy_q24, by_turn < MOST_BY_TURN ? (int32_t)by_turn : MOST_BY_TURN), 24);
    const bool blind = max_u32(c->gap_steps, c->gyro_clipped_steps) >= (uint32_t)p->block_steps;
    const int64_t growth = p->q_tilt + turned + c->tilt_added_q32 + (blind ? p->q_clipped : 0);
    return growth < VARIANCE_LIMIT_Q32 ? (int32_t)growth : VARIANCE_LIMIT_Q32;
}

/* The last step of a block: its sums become the coupling of tilt and gyro, a velocity, and the inputs of the
 * slices of the next block. Returns true when it has turned the attitude. */
SELDOM bool close_block(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t dt = (int32_t)p->dt_s_q33;
    const int32_t gains[2] = {gained(c->force_sum_q18[0], dt), gained(c->force_sum_q18[1], dt)};
    const bool aligning = c->aligned_blocks < ALIGNING_BLOCKS;
    if (!aligning) {
        note_turn(c, p);
    }
    bool moved = c->moved || c->airborne; /* a hovering vehicle may move as little as a resting one */

    for (unsigned i = 0; i < 3U; i++) {
        moved |= abs_u32(sub_wrap(c->force_sum_q18[i], c->force_before_q18[i])) > (uint32_t)p->rest_accel ||
                 abs_u32(c->half_sum_q32[i]) > (uint32_t)p->rest_turn;
        c->force_before_q18[i] = c->force_sum_q18[i];
        c->half_mean_q32[i] = mulhi_i32(c->half_sum_q32[i], p->inverse_block_q32);
    }
    c->still_blocks =
        (uint16_t)(moved ? 0U : min_u32(c->still_blocks + 1U, LONG_RESTS * (uint32_t)p->rest_blocks));
    const bool rests = c->still_blocks >= (uint32_t)p->rest_blocks;
    uint32_t flags = rests ? PLUMB_ATTITUDE_FLAG_REST : 0U;

    if (aligning) {
        /* the vertical is the mean of all samples so far; below 1/32 g s, as in a fall, nothing is turned */
        const int32_t x = saturated((int64_t)w->velocity_gs_q28[0] + gains[0]);
        const int32_t y = saturated((int64_t)w->velocity_gs_q28[1] + gains[1]);
        const int32_t z = saturated((int64_t)c->errors.correction_q28[0] + gained(c->force_sum_q18[2], dt));
        const uint32_t half = align(&w->attitude, asr32(x, 2), asr32(y, 2), asr32(z, 2), 1U << 20);
        c->errors.correction_q28[0] = (int32_t)min_u32(half << 3, INT32_MAX);
        w->velocity_gs_q28[0] = w->velocity_gs_q28[1] = 0;
        flags |= PLUMB_ATTITUDE_FLAG_UNSURE;
        if (++c->aligned_blocks == ALIGNING_BLOCKS) {
            c->errors.correction_q28[0] = 0;
        } else {
            flags |= PLUMB_ATTITUDE_FLAG_ALIGNING;
        }
    } else {
        const int32_t time_q32 = (int32_t)((uint32_t)p->block_steps * p->dt_s_q33 >> 1);
        const int32_t lever = saturated(asr64(mul_i64(c->force_sum_q18[2], dt), 20));
        c->errors.half_lever_q32 = asr32(clamp_i32(lever, asr32(time_q32, 2), time_q32), 1);
        for (unsigned i = 0; i < 2U; i++) {
            for (unsigned j = 0; j < 3U; j++) {
                c->errors.coupling_q32[i][BIAS + j] = -(int32_t)asr64(mul_i64(c->rows_sum_q22[i][j], dt), 25);
                c->errors.coupling_q32[i][SCALE + j] = -asr32(c->turned_sum_q28[i][j], 1);
            }
        }
        for (unsigned i = 0; i < 2U; i++) {
            w->velocity_gs_q28[i] = saturated((int64_t)w->velocity_gs_q28[i] + gains[i]);
        }
        if (p->aid_s_q24 != 0 || c->vehicle) {
            measure_velocity(c, p, gains, time_q32);
        }

        c->errors.tilt_growth_q32 = tilt_growth(c, p);
        c->errors.velocity_growth_q32 = 16 * c->velocity_added_q26;

        flags |= (lever < asr32(time_q32, 2) ? PLUMB_ATTITUDE_FLAG_FALLING : 0U) |
                 (c->airborne ? PLUMB_ATTITUDE_FLAG_AIRBORNE : 0U) | (c->block_flags & JUDGED);
        c->slice = SLICE_CORRECT;
        if (rests) {
            c->aligned_blocks = RESTED;
        }
    }
    c->block_flags = flags;
    w->block_step = 0;
    clear_sums(c);
    return aligning;
}

#endif
