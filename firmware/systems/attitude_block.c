#include "attitude_block.h"
#include "attitude_judge.h"
#include "attitude_shock.h"
#include "attitude_start.h"
#include "attitude_travel.h"
#include "attitude_turns.h"

#define TWO_BY_PI_Q31       1367130551 /* normalised bias (rad/s times 4) Q28 to turn/s Q32 */
#define BIAS_LIMIT_Q32      (1 << 30)  /* 90 deg/s */
#define SCALE_LIMIT_Q32     (1 << 28)
#define TILT_STEP_LIMIT_Q28 (1 << 26) /* largest correction of the tilt in a block, rad */
#define ALIGNING_BLOCKS     4U
#define MOST_BY_TURN        (1 << 30) /* growth of the tilt's variance by the square of a turn, Q32 */

/* Applies the corrections of the block before the last one, propagated over the last block, to the state. */
SELDOM static void correct(plumb_attitude_t *c) {
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
    plumb_attitude_turn_earth(&w->attitude, ONE_Q30, 2 * x, 2 * y);
    plumb_attitude_turn_force(c->force_before_q18, 16 * x, 16 * y);
    for (unsigned i = 0; i < 2U; i++) {
        w->velocity_gs_q28[i] =
            plumb_attitude_saturated(w->velocity_gs_q28[i] + 2 * (int64_t)by[VELOCITY + i]);
    }
}

SHARED PART bool plumb_attitude_compute_slice(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const unsigned slice = c->slice;
    const unsigned measured = (c->block_flags & PLUMB_ATTITUDE_FLAG_REST) != 0U ? 5U : 2U;
    const bool last = slice + 1U == SLICE_MEASURE + 2U * measured;
    c->slice = (uint8_t)(last ? SLICE_NONE : slice + 1U);
    if (slice == SLICE_CORRECT) {
        correct(c);
        return true;
    }
    if (slice == SLICE_JUDGE) {
        plumb_attitude_judge(c, p);
    } else if (slice < SLICE_MEASURE) {
        plumb_error_filter_grow_tilt(&c->errors, slice - SLICE_TILT_X);
    } else if ((slice - SLICE_MEASURE) % 2U != 0U) {
        plumb_error_filter_shrink(&c->errors);
    } else {
        const unsigned number = (slice - SLICE_MEASURE) / 2U;
        if (number == 0U) {
            plumb_error_filter_grow(&c->errors, plumb_attitude_travels(c) ? 0 : p->q_bias, p->q_scale);
        }
        if (number < 2U) {
            plumb_error_filter_weigh(
                &c->errors, VELOCITY + number, (uint64_t)c->words.velocity_variance_g2s2_q26 << 4,
                asr32(sub_wrap(c->measured_gs_q28[number], c->words.velocity_gs_q28[number]), 1));
        } else {
            plumb_error_filter_weigh(&c->errors, BIAS + number - 2U, (uint32_t)p->rest_variance,
                                     plumb_attitude_saturated(asr64(
                                         mul_i64(c->half_mean_q32[number - 2U], p->rest_gain_q20), 20)));
        }
    }
    return false;
}

/* Velocity that a block has gained, g s Q28. */
SELDOM static int32_t gained(int32_t force_sum_q18, int32_t dt_s_q33) {
    return plumb_attitude_saturated(asr64(mul_i64(force_sum_q18, dt_s_q33), 23));
}

/* Growth of the tilt's variance in a block, rad^2 Q32. A lasting velocity above that of a body that moves
 * little shows that turns are measured worse than the parameters expect, unless the body travels or flies. */
static int32_t tilt_growth(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const int32_t lasting_q24 = max_i32(plumb_attitude_travel_square(c) - (p->speed_min >> 2), 0);
    const int64_t doubt =
        plumb_attitude_travels(c) || c->airborne ? 0 : asr64(mul_i64(lasting_q24, p->doubt_q24), 16);
    const int64_t by_turn = p->q_turn_q24 + doubt;
    const int64_t turned =
        asr64(mul_i64((int32_t)c->energy_q24, by_turn < MOST_BY_TURN ? (int32_t)by_turn : MOST_BY_TURN), 24);
    const bool blind = max_u32(c->gap_steps, c->gyro_clipped_steps) >= (uint32_t)p->block_steps;
    const int64_t growth = p->q_tilt + turned + c->tilt_added_q32 + (blind ? p->q_clipped : 0);
    return growth < VARIANCE_LIMIT_Q32 ? (int32_t)growth : VARIANCE_LIMIT_Q32;
}

SELDOM PART bool plumb_attitude_close_block(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t dt = (int32_t)p->dt_s_q33;
    const int32_t gains[2] = {gained(c->force_sum_q18[0], dt), gained(c->force_sum_q18[1], dt)};
    const bool aligning = c->aligned_blocks < ALIGNING_BLOCKS;
    if (!aligning) {
        plumb_attitude_note_turn(c, p);
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
        const int32_t x = plumb_attitude_saturated((int64_t)w->velocity_gs_q28[0] + gains[0]);
        const int32_t y = plumb_attitude_saturated((int64_t)w->velocity_gs_q28[1] + gains[1]);
        const int32_t z =
            plumb_attitude_saturated((int64_t)c->errors.correction_q28[0] + gained(c->force_sum_q18[2], dt));
        const uint32_t half =
            plumb_attitude_align(&w->attitude, asr32(x, 2), asr32(y, 2), asr32(z, 2), 1U << 20);
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
        const int32_t lever = plumb_attitude_saturated(asr64(mul_i64(c->force_sum_q18[2], dt), 20));
        c->errors.half_lever_q32 = asr32(clamp_i32(lever, asr32(time_q32, 2), time_q32), 1);
        for (unsigned i = 0; i < 2U; i++) {
            for (unsigned j = 0; j < 3U; j++) {
                c->errors.coupling_q32[i][BIAS + j] = -(int32_t)asr64(mul_i64(c->rows_sum_q22[i][j], dt), 25);
                c->errors.coupling_q32[i][SCALE + j] = -asr32(c->turned_sum_q28[i][j], 1);
            }
        }
        for (unsigned i = 0; i < 2U; i++) {
            w->velocity_gs_q28[i] = plumb_attitude_saturated((int64_t)w->velocity_gs_q28[i] + gains[i]);
        }
        if (p->aid_s_q24 != 0 || c->vehicle) {
            plumb_attitude_measure_velocity(c, p, gains, time_q32);
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
    plumb_attitude_clear_sums(c);
    return aligning;
}
