#include "attitude_judge.h"
#include "attitude_shock.h"
#include "attitude_start.h"
#include "attitude_travel.h"

#define HOLD_Q32           1288490189 /* 0.3: a travel is held for 3.3 times the time constant that detects it */
#define SPEED_LIMIT_Q26    INT32_MAX  /* 32 g^2 s^2: largest variance of a measured velocity */
#define LEAST_REST_Q16     62300U     /* 0.975^2 g^2: the acceleration of a body at rest */
#define MOST_REST_Q16      68853U     /* 1.025^2 g^2 */
#define TILTED_Q24         15099494   /* 0.9 g: the cosine of 26 deg */
#define RESTING_SQUARE_Q24 104857600  /* (2.5 g s)^2: a body at rest is not as fast as 25 m/s */
#define MOST_LASTING_Q24   (1U << 23) /* (0.7 g s)^2: in flight, 20 deg of stated tilt */
#define FLIGHT_LEAST_Q32   2943711U   /* (1.5 deg)^2: what a step of the gyro's bias makes before it shows */

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
    const bool held = plumb_attitude_held_still(c, p);
    if (landed && (c->block_flags & PLUMB_ATTITUDE_FLAG_REST) != 0U &&
        (tilted_at_rest(c, p) ||
         (c->still_blocks == LONG_RESTS * (uint32_t)p->rest_blocks && square_q24 > RESTING_SQUARE_Q24))) {
        plumb_attitude_start(c, p);
        c->block_flags |= PLUMB_ATTITUDE_FLAG_RESTARTED;
    } else if (held || plumb_attitude_lost_in_motion(c, p, lasting_q24)) {
        const uint32_t bias = min_u32((uint32_t)p->start_bias, VARIANCE_LIMIT_Q32 / 4U) * 4U;
        plumb_attitude_forget(c, p, (int32_t)bias, asr32(p->start_tilt, 3));
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
SELDOM PART void plumb_attitude_judge(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
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
    const int32_t lasting_q24 = plumb_attitude_travel_square(c);
    w->velocity_square_g2s2_q24 += mulhi_near(square_q24 - w->velocity_square_g2s2_q24, p->velocity_pass_q32);
    c->travel_excess_q24 = c->airborne ? 0 : plumb_attitude_travel_excess(c, p, lasting_q24, hold_q32);
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
