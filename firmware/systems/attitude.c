#include "plumb/attitude.h"
#include "core/axis.h"
#include "core/calibration.h"
#include "core/error_filter.h"
#include "plumb/angle.h"
#include "plumb/mounting.h"

/* The kernels are compiled for the cycles of a small step. This one is large: without renamed registers, and
 * with the short forms of instructions, it takes 180 bytes of flash less, for one cycle in a hundred.
 */
#if defined(__GNUC__) && defined(__arm__)
#pragma GCC optimize("no-rename-registers", "peephole2")
#endif

#define ONE_Q30              (1 << 30)
#define SIXTH_Q32            715827883
#define TWELFTH_Q32          357913941
#define TWENTIETH_Q32        214748365
#define THIRTIETH_Q32        143165577
#define FORTY_SECOND_Q32     102261126
#define TWO_BY_PI_Q31        1367130551 /* normalised bias (rad/s times 4) Q28 to turn/s Q32 */
#define BIAS_LIMIT_Q32       (1 << 30)  /* 90 deg/s */
#define SCALE_LIMIT_Q32      (1 << 28)
#define VELOCITY_LIMIT_Q28   ((1 << 30) - 1) /* 4 g s, 39 m/s */
#define SPEED_LIMIT_Q26      INT32_MAX       /* 32 g^2 s^2: largest variance of a measured velocity */
#define TILT_STEP_LIMIT_Q28  (1 << 26)       /* largest correction of the tilt in a block, rad */
#define VELOCITY_ADDED_Q26   13421773U       /* 0.2 g^2 s^2: most that lost accelerations add to a block */
#define ADDED_ACCEL_G_Q20    1258291200      /* 1200 g: most that a bridge adds along an axis */
#define BRIDGED_FORCE_Q18    550502400       /* 2100 g: 125 steps more do not overflow */
#define LONGEST_RUN          255U            /* steps of a gap or at a limit: more are counted as so many */
#define WORTHLESS_G_Q25      5033165         /* 0.15 g: below it an acceleration tells no direction */
#define ALIGNING_BLOCKS      4U
#define LONGEST_BLOCK_S_Q33  2731598643U  /* 0.318 s: no sum of a block overflows */
#define MOST_HALF_ANGLES_Q34 (1ULL << 34) /* block_steps * half_angle: half angles of a block below 8 rad */
#define LEAST_REST_Q16       59146U       /* 0.95^2 g^2: the acceleration of a body at rest */
#define MOST_REST_Q16        72253U       /* 1.05^2 g^2 */
#define MOST_BY_TURN         (1 << 30)    /* growth of the tilt's variance by the square of a turn, Q32 */
#define RISE_LIMIT_Q18       157286       /* 0.6 g: no body falls with it for seconds */
#define RESTING_SQUARE_Q24   104857600    /* (2.5 g s)^2: a body at rest is not as fast as 25 m/s */
#define CARRIED_Q18          209715       /* 0.8 g: without thrust, a body that the ground carries */
#define TAKE_OFF_BLOCKS      4U           /* so many with thrust: it flies */
#define HOLD_Q32             1288490189 /* 0.3: a travel is remembered for 3.3 times the time that shows it */
#define TRAVELS_Q24          16777      /* 0.001 g^2 s^2: a smaller excess is no travel */
#define CLIPPED              (PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED | PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED)
#define JUDGED               (PLUMB_ATTITUDE_FLAG_UNSURE | PLUMB_ATTITUDE_FLAG_ACCELERATING)
#define HALF_LIMIT_Q30       461708984 /* 0.43 rad: with coning below 1/2 */

/* What a step computes of the last block. Each measurement takes two slices; velocity x, y, and at rest bias
 * x, y, z; the first one ends the growth, too. */
enum { SLICE_NONE, SLICE_CORRECT, SLICE_JUDGE, SLICE_TILT_X, SLICE_TILT_Y, SLICE_MEASURE };

typedef char attitude_assert_size[sizeof(plumb_attitude_t) <= 768U ? 1 : -1];

/* Once a block, or less: a call, and small rather than fast. Shared: in every step and in a gap, once in the
 * image. */
#if defined(__GNUC__)
#define SELDOM __attribute__((noinline, cold)) static
#define SHARED __attribute__((noinline)) static
#else
#define SELDOM static
#define SHARED static
#endif

/* sat_i32 of what is computed seldom: once in the image. */
SELDOM int32_t saturated(int64_t x) {
    return sat_i32(x);
}

static uint32_t limited(uint64_t x, uint32_t most) {
    return x < most ? (uint32_t)x : most;
}

/* Add to a variance, at most up to a limit. */
SELDOM void add_limited(int32_t *variance, uint64_t by, uint32_t most) {
    *variance = (int32_t)min_u32((uint32_t)*variance + limited(by, most), most);
}

/* The sums of a block that begins. */
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

/* As before the first sample; the heading stays. */
SELDOM void start(plumb_attitude_t *c, const plumb_attitude_params_t *a) {
    plumb_attitude_words_t *const w = &c->words;
    for (unsigned i = 0; i < 3U; i++)
        w->bias_turnps_q32[i] = w->scale_q32[i] = 0;
    w->velocity_gs_q28[0] = w->velocity_gs_q28[1] = 0;
    w->velocity_square_g2s2_q24 = 0;
    plumb_error_filter_start(&c->errors, a->start_bias, a->start_scale, a->start_tilt, a->start_speed);
    w->tilt_variance_rad2_q32 = 2U * (uint32_t)a->start_tilt;
    c->block_flags = PLUMB_ATTITUDE_FLAG_ALIGNING | PLUMB_ATTITUDE_FLAG_UNSURE;
    c->slice = SLICE_NONE;
    c->still_blocks = c->aligned_blocks = 0;
    c->travel_gs_q28[0] = c->travel_gs_q28[1] = 0;
    c->travel_excess_q24 = c->rise_g_q18 = 0;
    clear_sums(c);
}

void plumb_attitude_init(plumb_attitude_t *c, const plumb_params_t *p) {
    *c = (plumb_attitude_t){.words = {.attitude = {ONE_Q30, 0, 0, 0}, .up_q30 = {0, 0, ONE_Q30}}};
    start(c, &p->attitude);
}

/* Turn the earth's side of the attitude: (w, x, y, 0) * q, all Q30, then a first-order normalisation. */
SELDOM void turn_earth(plumb_quaternion_t *q, int32_t w, int32_t x, int32_t y) {
    const int32_t qw =
        wrap_i32((uint32_t)(mulhi_i32(w, q->w) - mulhi_i32(x, q->x) - mulhi_i32(y, q->y)) << 2);
    const int32_t qx =
        wrap_i32((uint32_t)(mulhi_i32(w, q->x) + mulhi_i32(x, q->w) + mulhi_i32(y, q->z)) << 2);
    const int32_t qy =
        wrap_i32((uint32_t)(mulhi_i32(w, q->y) + mulhi_i32(y, q->w) - mulhi_i32(x, q->z)) << 2);
    const int32_t qz =
        wrap_i32((uint32_t)(mulhi_i32(w, q->z) + mulhi_i32(x, q->y) - mulhi_i32(y, q->x)) << 2);
    const int32_t square_q28 = mulhi_i32(qw, qw) + mulhi_i32(qx, qx) + mulhi_i32(qy, qy) + mulhi_i32(qz, qz);
    const int32_t longer_q32 = ((1 << 28) - square_q28) * 8; /* (1 - |q|^2) / 2 */

    q->w = qw + mulhi_i32(qw, longer_q32);
    q->x = qx + mulhi_i32(qx, longer_q32);
    q->y = qy + mulhi_i32(qy, longer_q32);
    q->z = qz + mulhi_i32(qz, longer_q32);
}

/* Turn the attitude so that the acceleration (x, y, z), in earth axes, points up; components below 2^30.
 * Returns half its length; below `least` nothing is turned. */
SELDOM uint32_t align(plumb_quaternion_t *q, int32_t x, int32_t y, int32_t z, uint32_t least) {
    const uint32_t half = plumb_angle_length((int32_t)plumb_angle_length(y, x), asr32(z, 1)) << 1;
    if (half < least)
        return half;

    /* half of: (|a| + z, y, -x), the quaternion that turns a to the vertical, of any length */
    const int32_t w = (int32_t)half + asr32(z, 1), qx = asr32(y, 1), qy = -asr32(x, 1);
    const uint32_t length = plumb_angle_length((int32_t)plumb_angle_length(qy, qx), asr32(w, 1)) << 2;
    if (length < half >> 8) { /* upside down: any half turn will do */
        turn_earth(q, 0, ONE_Q30, 0);
        return half;
    }
    const unsigned n = clz32(length);
    const int32_t inverse = (int32_t)reciprocal_q61(length << n >> 1); /* 2^(62 - n) / length */
    turn_earth(q, (int32_t)asr64(mul_i64(w, inverse), 32U - n), (int32_t)asr64(mul_i64(qx, inverse), 32U - n),
               (int32_t)asr64(mul_i64(qy, inverse), 32U - n));
    return half;
}

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

/* Turn an acceleration of the earth by a small angle, as the attitude is turned: rest is a matter of the
 * body, and a correction is no motion. */
SELDOM void turn_force(int32_t force[3], int32_t x_q32, int32_t y_q32) {
    const int32_t fx = force[0], fy = force[1], fz = force[2];
    force[0] = add_wrap(fx, mulhi_i32(y_q32, fz));
    force[1] = sub_wrap(fy, mulhi_i32(x_q32, fz));
    force[2] = add_wrap(fz, sub_wrap(mulhi_i32(x_q32, fy), mulhi_i32(y_q32, fx)));
}

/* The corrections of the block before, as the last one has made them grow, to the state. */
SELDOM void correct(plumb_attitude_t *c) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t *const by = c->errors.correction_q28;

    plumb_error_filter_predict(&c->errors);
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t bias = (int32_t)asr64(mul_i64(by[BIAS + i], TWO_BY_PI_Q31) + (1 << 30), 31);
        w->bias_turnps_q32[i] =
            clamp_i32(w->bias_turnps_q32[i] + clamp_i32(bias, -BIAS_LIMIT_Q32, BIAS_LIMIT_Q32),
                      -BIAS_LIMIT_Q32, BIAS_LIMIT_Q32);
        w->scale_q32[i] =
            clamp_i32(w->scale_q32[i] + asr32(by[SCALE + i], 2), -SCALE_LIMIT_Q32, SCALE_LIMIT_Q32);
    }
    const int32_t x = clamp_i32(by[TILT], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28);
    const int32_t y = clamp_i32(by[TILT + 1], -TILT_STEP_LIMIT_Q28, TILT_STEP_LIMIT_Q28);
    turn_earth(&w->attitude, ONE_Q30, 2 * x, 2 * y);
    turn_force(c->force_before_q18, 16 * x, 16 * y);
    for (unsigned i = 0; i < 2U; i++)
        w->velocity_gs_q28[i] = saturated(w->velocity_gs_q28[i] + 2 * (int64_t)by[VELOCITY + i]);
}

/* A body at rest whose acceleration is 1 g, within 5 %, and 26 deg or more off the vertical: a body that
 * accelerates horizontally so much would feel 1.11 g. */
static bool tilted_at_rest(const int32_t mean_g_q18[3]) {
    uint32_t square_q16 = 0, up_q16 = 0;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t mean_g_q24 = wrap_i32((uint32_t)mean_g_q18[i] << 6);
        up_q16 = (uint32_t)mulhi_i32(mean_g_q24, mean_g_q24);
        square_q16 += up_q16;
    }
    return square_q16 > LEAST_REST_Q16 && square_q16 < MOST_REST_Q16 &&
           (mean_g_q18[2] < 0 || up_q16 * 100U < square_q16 * 81U);
}

/* Whether the acceleration of the last block contradicts the vertical: that of a body that rests, or what has
 * lasted. */
static bool contradicts(plumb_attitude_t *c, const plumb_attitude_params_t *p, bool rests) {
    int32_t mean_g_q18[3];
    for (unsigned i = 0; i < 3U; i++)
        mean_g_q18[i] = mulhi_i32(c->force_before_q18[i], p->inverse_block_q32);
    c->rise_g_q18 += mulhi_near((1 << 18) - mean_g_q18[2] - c->rise_g_q18, p->travel_pass_q32);
    return c->rise_g_q18 > RISE_LIMIT_Q18 || (rests && tilted_at_rest(mean_g_q18));
}

/* What a block has shown of the velocity: how far it is trusted to be zero, and whether the attitude is
 * lost. Then a new start, or the first growth of the covariance.
 *
 * The stated variance has, besides the filter's, the tilt that keeps up a velocity that has lasted: in flight
 * against the drag, which the filter follows in 2 s; else in 128 s, less than the velocity's own leak. */
SELDOM void judge(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    plumb_attitude_words_t *const w = &c->words;
    int32_t square_q24 = 0;
    for (unsigned i = 0; i < 2U; i++) {
        const int32_t v = clamp_i32(w->velocity_gs_q28[i], -VELOCITY_LIMIT_Q28, VELOCITY_LIMIT_Q28);
        w->velocity_gs_q28[i] = c->airborne ? v : v - mulhi_near(v, p->leak_q32);
        square_q24 += mulhi_i32(w->velocity_gs_q28[i], w->velocity_gs_q28[i]);
        const int32_t off =
            clamp_i32(w->velocity_gs_q28[i] - c->measured_gs_q28[i], -VELOCITY_LIMIT_Q28, VELOCITY_LIMIT_Q28);
        c->travel_gs_q28[i] += mulhi_near(off - c->travel_gs_q28[i], p->travel_pass_q32);
    }
    w->velocity_square_g2s2_q24 += mulhi_near(square_q24 - w->velocity_square_g2s2_q24, p->velocity_pass_q32);
    c->travel_excess_q24 = c->airborne ? 0 : travel_excess(c, p);
    const int64_t moving = asr64(mul_i64(w->velocity_square_g2s2_q24, p->velocity_share_q16), 14) +
                           asr64(mul_i64(c->travel_excess_q24, p->travel_gain_q16), 14);
    const int32_t room = SPEED_LIMIT_Q26 - p->speed_min;
    w->velocity_variance_g2s2_q26 =
        c->airborne ? (uint32_t)p->aid_variance
                    : (uint32_t)p->speed_min + (uint32_t)(moving < room ? (int32_t)moving : room);

    w->tilt_variance_rad2_q32 =
        plumb_error_filter_variance(&c->errors, TILT) + plumb_error_filter_variance(&c->errors, TILT + 1);
    const uint32_t lasting_q24 = (uint32_t)travel_square(c);
    w->tilt_variance_rad2_q32 += c->airborne ? min_u32(lasting_q24, 1U << 25) << 6 : lasting_q24 >> 6;
    const bool unsure = w->tilt_variance_rad2_q32 > p->unsure;
    const bool accelerating = w->velocity_variance_g2s2_q26 > 4U * (uint32_t)p->speed_min;
    c->block_flags = (c->block_flags & ~(uint32_t)JUDGED) | (unsure ? PLUMB_ATTITUDE_FLAG_UNSURE : 0U) |
                     (accelerating ? PLUMB_ATTITUDE_FLAG_ACCELERATING : 0U);
    const bool rests = (c->block_flags & PLUMB_ATTITUDE_FLAG_REST) != 0U;
    if (contradicts(c, p, rests) || (rests && square_q24 > RESTING_SQUARE_Q24)) {
        start(c, p);
        c->block_flags |= PLUMB_ATTITUDE_FLAG_RESTARTED;
    } else {
        plumb_error_filter_grow_velocity(&c->errors);
    }
}

/* What the last block has left to do, one slice a step. Returns whether it has turned the attitude. */
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
        if (number == 0U)
            plumb_error_filter_grow(&c->errors, travels(c) ? 0 : p->q_bias, p->q_scale);
        if (number < 2U)
            plumb_error_filter_weigh(
                &c->errors, VELOCITY + number, (uint64_t)c->words.velocity_variance_g2s2_q26 << 4,
                asr32(sub_wrap(c->measured_gs_q28[number], c->words.velocity_gs_q28[number]), 1));
        else
            plumb_error_filter_weigh(
                &c->errors, BIAS + number - 2U, (uint32_t)p->rest_variance,
                saturated(asr64(mul_i64(c->half_mean_q32[number - 2U], p->rest_gain_q20), 20)));
    }
    return false;
}

/* Velocity that a block has gained, g s Q28. */
SELDOM int32_t gained(int32_t force_sum_q18, int32_t dt_s_q33) {
    return saturated(asr64(mul_i64(force_sum_q18, dt_s_q33), 23));
}

/* How much the tilt has become uncertain in a block, rad^2 Q32. Lasting velocities say that turns were
 * measured worse than the parameters expect, unless the body travels or flies. */
static int32_t tilt_growth(const plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    const int64_t doubt = travels(c) || c->airborne ? 0 : asr64(mul_i64(travel_square(c), p->doubt_q24), 16);
    const int64_t by_turn = p->q_turn_q24 + doubt;
    const int64_t turned =
        asr64(mul_i64((int32_t)c->energy_q24, by_turn < MOST_BY_TURN ? (int32_t)by_turn : MOST_BY_TURN), 24);
    const bool blind = max_u32(c->gap_steps, c->gyro_clipped_steps) >= (uint32_t)p->block_steps;
    const int64_t growth = p->q_tilt + turned + c->tilt_added_q32 + (blind ? p->q_clipped : 0);
    return growth < VARIANCE_LIMIT_Q32 ? (int32_t)growth : VARIANCE_LIMIT_Q32;
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

/* The last step of a block: its sums become the coupling of tilt and gyro, a velocity, and what the slices of
 * the next block need. Returns whether it has turned the attitude. */
SELDOM bool close_block(plumb_attitude_t *c, const plumb_attitude_params_t *p) {
    plumb_attitude_words_t *const w = &c->words;
    const int32_t dt = (int32_t)p->dt_s_q33;
    const int32_t gains[2] = {gained(c->force_sum_q18[0], dt), gained(c->force_sum_q18[1], dt)};
    bool moved = c->moved;

    for (unsigned i = 0; i < 3U; i++) {
        moved |= abs_u32(sub_wrap(c->force_sum_q18[i], c->force_before_q18[i])) > (uint32_t)p->rest_accel ||
                 abs_u32(c->half_sum_q32[i]) > (uint32_t)p->rest_turn;
        c->force_before_q18[i] = c->force_sum_q18[i];
        c->half_mean_q32[i] = mulhi_i32(c->half_sum_q32[i], p->inverse_block_q32);
    }
    const uint32_t still = c->still_blocks + 1U;
    c->still_blocks = (uint8_t)(moved ? 0U : min_u32(still, (uint32_t)p->rest_blocks));
    const bool rests = c->still_blocks == (uint32_t)p->rest_blocks;
    uint32_t flags = rests ? PLUMB_ATTITUDE_FLAG_REST : 0U;

    const bool aligning = c->aligned_blocks < ALIGNING_BLOCKS;
    if (aligning) {
        /* the vertical is the mean of all so far; at least 1/32 g s, so that a fall turns nothing */
        const int32_t x = saturated((int64_t)w->velocity_gs_q28[0] + gains[0]);
        const int32_t y = saturated((int64_t)w->velocity_gs_q28[1] + gains[1]);
        const int32_t z = saturated((int64_t)c->errors.correction_q28[0] + gained(c->force_sum_q18[2], dt));
        const uint32_t half = align(&w->attitude, asr32(x, 2), asr32(y, 2), asr32(z, 2), 1U << 20);
        c->errors.correction_q28[0] = (int32_t)min_u32(half << 3, INT32_MAX);
        w->velocity_gs_q28[0] = w->velocity_gs_q28[1] = 0;
        flags |= PLUMB_ATTITUDE_FLAG_UNSURE;
        if (++c->aligned_blocks == ALIGNING_BLOCKS)
            c->errors.correction_q28[0] = 0;
        else
            flags |= PLUMB_ATTITUDE_FLAG_ALIGNING;
    } else {
        const int32_t time_q32 = (int32_t)((uint32_t)p->block_steps * p->dt_s_q33 >> 1);
        const int32_t lever = saturated(asr64(mul_i64(c->force_sum_q18[2], dt), 20));
        c->errors.half_lever_q32 = asr32(clamp_i32(lever, asr32(time_q32, 2), time_q32), 1);
        for (unsigned i = 0; i < 2U; i++)
            for (unsigned j = 0; j < 3U; j++) {
                c->errors.coupling_q32[i][BIAS + j] = -(int32_t)asr64(mul_i64(c->rows_sum_q22[i][j], dt), 25);
                c->errors.coupling_q32[i][SCALE + j] = -asr32(c->turned_sum_q28[i][j], 1);
            }
        for (unsigned i = 0; i < 2U; i++)
            w->velocity_gs_q28[i] = saturated((int64_t)w->velocity_gs_q28[i] + gains[i]);
        if (p->aid_s_q24 != 0)
            measure_velocity(c, p, gains);

        c->errors.tilt_growth_q32 = tilt_growth(c, p);
        c->errors.velocity_growth_q32 = 16 * c->velocity_added_q26;

        flags |= (lever < asr32(time_q32, 2) ? PLUMB_ATTITUDE_FLAG_FALLING : 0U) |
                 (c->airborne ? PLUMB_ATTITUDE_FLAG_AIRBORNE : 0U) | (c->block_flags & JUDGED);
        c->slice = SLICE_CORRECT;
    }
    c->block_flags = flags;
    w->block_step = 0;
    clear_sums(c);
    return aligning;
}

/* Turns rate and acceleration from the sensors' axes to the body's. */
SELDOM uint32_t mount(const plumb_params_t *p, int32_t rate[3], int32_t accel[3]) {
    return (plumb_mounting_apply(&p->gyro_mounting, rate) ? 0U : PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED) |
           (plumb_mounting_apply(&p->accel_mounting, accel) ? 0U : PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED);
}

/* Rate of one axis, less bias and scale error. */
KERNEL int32_t corrected(const plumb_attitude_words_t *w, unsigned axis, int32_t rate_q28) {
    return rate_q28 - asr32(w->bias_turnps_q32[axis], 4) - mulhi_i32(w->scale_q32[axis], rate_q28);
}

/* Half the angle that a rate turns in a step, rad Q32, within 1/2. */
KERNEL int32_t half_angle(int32_t rate_q28, int32_t per_rate) {
    return clamp_i32(mulhi_i32(rate_q28, per_rate), -HALF_LIMIT_Q30, HALF_LIMIT_Q30) * 4;
}

/* Rate and acceleration of a sample, in body axes. */
KERNEL uint32_t take_sample(plumb_attitude_words_t *w, const plumb_params_t *p, const int16_t raw[6]) {
    const uint32_t gyro = PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED, accel = PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED;
    uint32_t flags = 0;
    int32_t rx = calibration_apply(&p->gyro, raw[0], &flags, gyro);
    int32_t ry = calibration_apply(&p->gyro, raw[1], &flags, gyro);
    int32_t rz = calibration_apply(&p->gyro, raw[2], &flags, gyro);
    int32_t ax = calibration_apply(&p->accel, raw[3], &flags, accel);
    int32_t ay = calibration_apply(&p->accel, raw[4], &flags, accel);
    int32_t az = calibration_apply(&p->accel, raw[5], &flags, accel);
    if (p->attitude.mounted != 0U) {
        int32_t rates[3] = {rx, ry, rz}, accels[3] = {ax, ay, az};
        flags |= mount(p, rates, accels);
        rx = rates[0], ry = rates[1], rz = rates[2];
        ax = accels[0], ay = accels[1], az = accels[2];
    }
    w->accel_g_q25[0] = asr32(ax, 1);
    w->accel_g_q25[1] = asr32(ay, 1);
    w->accel_g_q25[2] = asr32(az, 1);
    w->rate_turnps_q28[0] = corrected(w, 0, rx);
    w->rate_turnps_q28[1] = corrected(w, 1, ry);
    w->rate_turnps_q28[2] = corrected(w, 2, rz);
    return flags;
}

/* One row of the attitude's matrix into the coupling of the block. */
KERNEL void add_row(int32_t rows[3], int32_t turned[3], const int32_t m[3], const int32_t half[3]) {
    rows[0] += asr32(m[0], 8);
    rows[1] += asr32(m[1], 8);
    rows[2] += asr32(m[2], 8);
    turned[0] += asr32(mulhi_i32(m[0], half[0]), 2);
    turned[1] += asr32(mulhi_i32(m[1], half[1]), 2);
    turned[2] += asr32(mulhi_i32(m[2], half[2]), 2);
}

/* Component of an acceleration along a row, Q23 of Q25. */
KERNEL int32_t along(const int32_t m[3], int32_t x, int32_t y, int32_t z) {
    return mulhi_i32(m[0], x) + mulhi_i32(m[1], y) + mulhi_i32(m[2], z);
}

/* Turn the attitude by half angles (rad Q32, within 1/2 each) about body axes. Returns their square, Q30.
 * sin(h) / h = 1 - h^2/6 (1 - h^2/20 (1 - h^2/42)), cos(h) = 1 - h^2/2 (1 - h^2/12 (1 - h^2/30)) */
SHARED uint32_t turn_body(plumb_quaternion_t *q, int32_t hx, int32_t hy, int32_t hz) {
    const uint32_t square =
        ((uint32_t)mulhi_i32(hx, hx) + (uint32_t)mulhi_i32(hy, hy) + (uint32_t)mulhi_i32(hz, hz)) >> 2;
    const int32_t s = any_i32((int32_t)square);
    const int32_t sine =
        ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, FORTY_SECOND_Q32)), TWENTIETH_Q32);
    const int32_t missing_q32 = 4 * mulhi_i32(4 * mulhi_i32(s, sine), SIXTH_Q32); /* 1 - sin(h) / h */
    const int32_t cosine =
        ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, THIRTIETH_Q32)), TWELFTH_Q32);
    const int32_t c = -8 * mulhi_i32(s, cosine); /* cos(h) - 1, Q32 */
    const int32_t x = hx - mulhi_i32(hx, missing_q32);
    const int32_t y = hy - mulhi_i32(hy, missing_q32);
    const int32_t z = hz - mulhi_i32(hz, missing_q32);
    int32_t qw = q->w, qx = q->x, qy = q->y, qz = q->z;
    LOADED4(qw, qx, qy, qz);
    q->w = qw + mulhi_i32(qw, c) - mulhi_i32(qx, x) - mulhi_i32(qy, y) - mulhi_i32(qz, z);
    q->x = qx + mulhi_i32(qx, c) + mulhi_i32(qw, x) + mulhi_i32(qy, z) - mulhi_i32(qz, y);
    q->y = qy + mulhi_i32(qy, c) + mulhi_i32(qw, y) + mulhi_i32(qz, x) - mulhi_i32(qx, z);
    q->z = qz + mulhi_i32(qz, c) + mulhi_i32(qw, z) + mulhi_i32(qx, y) - mulhi_i32(qy, x);
    return square;
}

/* Rows of the attitude's matrix, Q30: from body to earth. */
SHARED void matrix_of(const plumb_quaternion_t *q, int32_t m[9]) {
    int32_t w = q->w, x = q->x, y = q->y, z = q->z;
    LOADED4(w, x, y, z);
    const int32_t xx = mulhi_i32(x, x), yy = mulhi_i32(y, y), zz = mulhi_i32(z, z);
    const int32_t xy = mulhi_i32(x, y), xz = mulhi_i32(x, z), yz = mulhi_i32(y, z);
    const int32_t wx = mulhi_i32(w, x), wy = mulhi_i32(w, y), wz = mulhi_i32(w, z);
    m[0] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(yy + zz) << 3));
    m[1] = wrap_i32((uint32_t)(xy - wz) << 3);
    m[2] = wrap_i32((uint32_t)(xz + wy) << 3);
    m[3] = wrap_i32((uint32_t)(xy + wz) << 3);
    m[4] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(xx + zz) << 3));
    m[5] = wrap_i32((uint32_t)(yz - wx) << 3);
    m[6] = wrap_i32((uint32_t)(xz - wy) << 3);
    m[7] = wrap_i32((uint32_t)(yz + wx) << 3);
    m[8] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(xx + yy) << 3));
}

/* A sample after a gap: turn and acceleration of the gap become those of a straight line between the samples
 * on both sides, and their variance that of a random walk between them: (time * difference)^2 / 12, with the
 * difference of all three axes and half as much again, as one difference tells little of a motion.
 * force_g_q20: what the gap adds to the acceleration, body axes. */
SELDOM void bridge(plumb_attitude_t *c, const plumb_attitude_params_t *a, const int32_t half[3],
                   int32_t force_g_q20[3]) {
    const int32_t steps = c->gap_steps;
    int32_t turn_q32[3];
    uint32_t turn_square_q32 = 0, force_square_q18 = 0;
    c->gap_steps = 0;
    force_g_q20[0] = force_g_q20[1] = force_g_q20[2] = 0;
    if (!c->started)
        return;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t by = asr32(half[i], 1) - 3 * c->half_sixth_q32[i];
        const int32_t by_g_q25 = c->words.accel_g_q25[i] - 6 * c->accel_sixth_q25[i];
        turn_square_q32 += (uint32_t)mulhi_i32(by, by);
        force_square_q18 += (uint32_t)mulhi_i32(by_g_q25, by_g_q25);
        turn_q32[i] =
            clamp_i32(sat_i32(asr64(mul_i64(by, steps), 1)), -4 * HALF_LIMIT_Q30, 4 * HALF_LIMIT_Q30);
        force_g_q20[i] = sat_i32(asr64(mul_i64(by_g_q25, steps), 6));
        force_g_q20[i] = clamp_i32(force_g_q20[i], -ADDED_ACCEL_G_Q20, ADDED_ACCEL_G_Q20);
    }
    for (unsigned i = 0; i < 2U; i++) /* two halves: each within the limit of a step */
        (void)turn_body(&c->words.attitude, turn_q32[0], turn_q32[1], turn_q32[2]);

    const uint32_t square = (uint32_t)(steps * steps);
    add_limited(&c->tilt_added_q32, 2U * mul_u64(square, turn_square_q32), VARIANCE_LIMIT_Q32);
    const uint32_t gap_s2_q26 = (uint32_t)(mul_u64(square, mulhi_u32(a->dt_s_q33, a->dt_s_q33)) >> 8);
    add_limited(&c->velocity_added_q26, mul_u64(gap_s2_q26, force_square_q18) >> 21, VELOCITY_ADDED_Q26);
}

/* The acceleration that a gap adds to the sums of the block. */
SELDOM void add_force(plumb_attitude_t *c, const int32_t m[9], const int32_t force_g_q20[3]) {
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t added_g_q18 = along(m + 3U * i, force_g_q20[0], force_g_q20[1], force_g_q20[2]);
        c->force_sum_q18[i] = clamp_i32(sat_i32((int64_t)c->force_sum_q18[i] + added_g_q18),
                                        -BRIDGED_FORCE_Q18, BRIDGED_FORCE_Q18);
    }
}

/* Samples in a row at the limit of a sensor: counted, and when they end, n^4 times the square of a slope.
 * What they do not show is taken for a parabola that begins with the larger slope of both ends, time^2 slope
 * / 6 in all; the variance of something between that and nothing is a third of its square. now, sixth: of
 * this step, and a sixth of the step before; a sixth of their difference is a slope, times 36 its square. */
static uint64_t unseen(uint8_t *run, uint32_t *slope, bool clipped, const int32_t now[3],
                       const int32_t sixth[3]) {
    const uint32_t steps = *run;
    if (clipped == (steps != 0U)) { /* it goes on, or there is none */
        *run = (uint8_t)(clipped ? min_u32(steps + 1U, LONGEST_RUN) : 0U);
        return 0U;
    }
    uint32_t square = 0;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t by = mulhi_i32(now[i], SIXTH_Q32) - sixth[i];
        square += (uint32_t)mulhi_i32(by, by);
    }
    *run = clipped;
    *slope = clipped ? square : max_u32(square, *slope);
    return clipped ? 0U : mul_u64(steps * steps * steps * steps, *slope);
}

/* Count samples at the limits, and add what they have hidden when they end. */
SELDOM void count_clipped(plumb_attitude_t *c, const plumb_attitude_params_t *a, uint32_t flags,
                          const int32_t half[3]) {
    if (flags == PLUMB_ATTITUDE_FLAG_MISSING || !c->started)
        return;
    const uint64_t turned = unseen(&c->gyro_clipped_steps, &c->gyro_slope_q32,
                                   (flags & PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED) != 0U, half, c->half_sixth_q32);
    const uint64_t forced =
        unseen(&c->accel_clipped_steps, &c->accel_slope_q18,
               (flags & PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED) != 0U, c->words.accel_g_q25, c->accel_sixth_q25);
    const uint32_t thrice_q32 = limited(turned, VARIANCE_LIMIT_Q32) * 4U;
    add_limited(&c->tilt_added_q32, thrice_q32 / 3U, VARIANCE_LIMIT_Q32);
    const uint64_t force_q8 = forced >> 10 < 1ULL << 40 ? forced >> 10 : 1ULL << 40;
    const uint64_t square_q26 = force_q8 * mulhi_u32(a->dt_s_q33, a->dt_s_q33) >> 16;
    add_limited(&c->velocity_added_q26, limited(square_q26, 3U * VELOCITY_ADDED_Q26) / 3U,
                VELOCITY_ADDED_Q26);
}

void plumb_attitude_step(plumb_attitude_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint) {
    plumb_attitude_words_t *const w = &c->words;
    const plumb_attitude_params_t *const a = &p->attitude;
    axis_record_raw(w->raw, raw);
    w->thrust_q15 = setpoint;
    w->step++;

    /* Without a sample rate and acceleration go on. The last step of a block takes none after a gap: a bridge
     * and the end of a block are each the work of a step. */
    uint32_t flags = PLUMB_ATTITUDE_FLAG_MISSING;
    if (raw[0] == INT16_MIN || (c->gap_steps != 0U && w->block_step + 1U == (uint32_t)a->block_steps)) {
        w->missing_steps++;
        c->gap_steps = (uint8_t)min_u32(c->gap_steps + 1U, LONGEST_RUN);
    } else {
        flags = take_sample(w, p, raw);
    }
    const int32_t hx = half_angle(w->rate_turnps_q28[0], a->half_angle);
    const int32_t hy = half_angle(w->rate_turnps_q28[1], a->half_angle);
    const int32_t hz = half_angle(w->rate_turnps_q28[2], a->half_angle);
    const int32_t half[3] = {hx, hy, hz};
    const int32_t ax = w->accel_g_q25[0], ay = w->accel_g_q25[1], az = w->accel_g_q25[2];
    const bool bridged = c->gap_steps != 0U && flags != PLUMB_ATTITUDE_FLAG_MISSING;
    int32_t force_g_q20[3];
    if (bridged)
        bridge(c, a, half, force_g_q20);
    if (((flags & CLIPPED) | c->gyro_clipped_steps | c->accel_clipped_steps) != 0U)
        count_clipped(c, a, flags, half);
    if (!c->started) {
        c->started = align(&w->attitude, asr32(ax, 1), asr32(ay, 1), asr32(az, 1), WORTHLESS_G_Q25 / 4U) >=
                     WORTHLESS_G_Q25 / 4U;
        for (unsigned i = 0; i < 3U; i++) {
            c->half_sixth_q32[i] = mulhi_i32(half[i], SIXTH_Q32);
            c->accel_sixth_q25[i] = mulhi_i32(w->accel_g_q25[i], SIXTH_Q32);
            c->half_mean_q32[i] = half[i];
        }
    }

    /* the mean acceleration of the step as the end of the step sees it: with half the turn, and sculling
     * (P. Savage, Strapdown inertial navigation integration algorithm design part 2, 1998) */
    const int32_t ex = sub_wrap(c->half_sixth_q32[0], hx), ey = sub_wrap(c->half_sixth_q32[1], hy),
                  ez = sub_wrap(c->half_sixth_q32[2], hz);
    const int32_t bx = c->accel_sixth_q25[0], by = c->accel_sixth_q25[1], bz = c->accel_sixth_q25[2];
    const int32_t fx = ax + mulhi_i32(ey, az) - mulhi_i32(ez, ay) + mulhi_i32(by, hz) - mulhi_i32(bz, hy);
    const int32_t fy = ay + mulhi_i32(ez, ax) - mulhi_i32(ex, az) + mulhi_i32(bz, hx) - mulhi_i32(bx, hz);
    const int32_t fz = az + mulhi_i32(ex, ay) - mulhi_i32(ey, ax) + mulhi_i32(bx, hy) - mulhi_i32(by, hx);
    /* coning: the axis of the turn itself has turned (the same author, part 1) */
    const int32_t sx = c->half_sixth_q32[0], sy = c->half_sixth_q32[1], sz = c->half_sixth_q32[2];
    const int32_t turn_x = hx + mulhi_i32(sy, hz) - mulhi_i32(sz, hy);
    const int32_t turn_y = hy + mulhi_i32(sz, hx) - mulhi_i32(sx, hz);
    const int32_t turn_z = hz + mulhi_i32(sx, hy) - mulhi_i32(sy, hx);
    c->half_sixth_q32[0] = mulhi_i32(hx, SIXTH_Q32);
    c->half_sixth_q32[1] = mulhi_i32(hy, SIXTH_Q32);
    c->half_sixth_q32[2] = mulhi_i32(hz, SIXTH_Q32);
    c->accel_sixth_q25[0] = mulhi_i32(ax, SIXTH_Q32);
    c->accel_sixth_q25[1] = mulhi_i32(ay, SIXTH_Q32);
    c->accel_sixth_q25[2] = mulhi_i32(az, SIXTH_Q32);

    int32_t m[9];
    c->energy_q24 += turn_body(&w->attitude, turn_x, turn_y, turn_z) >> 6;
    matrix_of(&w->attitude, m);
    if (bridged)
        add_force(c, m, force_g_q20);
    c->force_sum_q18[0] += asr32(along(m, fx, fy, fz), 5);
    c->force_sum_q18[1] += asr32(along(m + 3, fx, fy, fz), 5);
    c->force_sum_q18[2] += asr32(along(m + 6, fx, fy, fz), 5);
    if (a->aid_s_q24 != 0) { /* of the acceleration along the body's z, which is thrust */
        c->thrust_sum_q18[0] += asr32(mulhi_i32(m[2], fz), 5);
        c->thrust_sum_q18[1] += asr32(mulhi_i32(m[5], fz), 5);
    }
    add_row(c->rows_sum_q22[0], c->turned_sum_q28[0], m, half);
    add_row(c->rows_sum_q22[1], c->turned_sum_q28[1], m + 3, half);
    const uint32_t still = (uint32_t)a->rest_gyro;
    c->half_sum_q32[0] = add_wrap(c->half_sum_q32[0], hx);
    c->half_sum_q32[1] = add_wrap(c->half_sum_q32[1], hy);
    c->half_sum_q32[2] = add_wrap(c->half_sum_q32[2], hz);
    c->moved = c->moved || abs_u32(sub_wrap(hx, c->half_mean_q32[0])) > still ||
               abs_u32(sub_wrap(hy, c->half_mean_q32[1])) > still ||
               abs_u32(sub_wrap(hz, c->half_mean_q32[2])) > still;

    bool turned = c->slice != SLICE_NONE && !bridged && compute_slice(c, a);
    if (++w->block_step == (uint32_t)a->block_steps)
        turned |= close_block(c, a);
    if (turned)
        matrix_of(&w->attitude, m);
    w->up_q30[0] = m[6];
    w->up_q30[1] = m[7];
    w->up_q30[2] = m[8];
    w->flags = flags | c->block_flags;
}

bool plumb_attitude_params_valid(const plumb_params_t *p) {
    const plumb_attitude_params_t *const a = &p->attitude;
    const uint64_t block_s_q33 = (uint64_t)a->block_steps * a->dt_s_q33;
    const uint64_t half_angles_q34 = (uint64_t)a->block_steps * (uint32_t)a->half_angle;
    return plumb_calibration_valid(&p->gyro) && plumb_calibration_valid(&p->accel) &&
           plumb_mounting_valid(&p->gyro_mounting) && plumb_mounting_valid(&p->accel_mounting) &&
           a->dt_s_q33 <= 188978561U && a->block_steps >= 15 && a->block_steps <= 125 && a->mounted <= 1U &&
           block_s_q33 <= LONGEST_BLOCK_S_Q33 && half_angles_q34 <= MOST_HALF_ANGLES_Q34;
}
