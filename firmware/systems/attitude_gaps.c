#include "attitude_gaps.h"
#include "attitude_turns.h"

#define ADDED_ACCEL_G_Q20 1258291200      /* 1200 g: most that a bridge adds along an axis */
#define NO_FORCE          (3 * INT16_MIN) /* sum of three counts that all say: no acceleration */
#define BRIDGED_FORCE_Q18 550502400       /* 2100 g: 125 steps more do not overflow */

SELDOM PART void plumb_attitude_bridge(plumb_attitude_t *c, const plumb_attitude_params_t *a,
                                       const int32_t half[3], int32_t force_g_q20[3]) {
    const int32_t steps = c->gap_steps;
    int32_t turn_q32[3];
    uint32_t turn_square_q32 = 0, force_square_q18 = 0;
    c->gap_steps = 0;
    force_g_q20[0] = force_g_q20[1] = force_g_q20[2] = 0;
    if (!c->started) {
        return;
    }
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
    for (unsigned i = 0; i < 2U; i++) { /* two halves: each within the limit of a step */
        (void)plumb_attitude_turn_body(&c->words.attitude, turn_q32[0], turn_q32[1], turn_q32[2]);
    }

    const uint32_t square = (uint32_t)(steps * steps);
    plumb_attitude_add_limited(&c->tilt_added_q32, 2U * mul_u64(square, turn_square_q32), VARIANCE_LIMIT_Q32);
    const uint32_t gap_s2_q26 = (uint32_t)(mul_u64(square, mulhi_u32(a->dt_s_q33, a->dt_s_q33)) >> 8);
    plumb_attitude_add_limited(&c->velocity_added_q26, mul_u64(gap_s2_q26, force_square_q18) >> 21,
                               VELOCITY_ADDED_Q26);
}

SELDOM PART void plumb_attitude_add_force(plumb_attitude_t *c, const int32_t m[9],
                                          const int32_t force_g_q20[3]) {
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t added_g_q18 = along(m + 3U * i, force_g_q20[0], force_g_q20[1], force_g_q20[2]);
        c->force_sum_q18[i] = clamp_i32(sat_i32((int64_t)c->force_sum_q18[i] + added_g_q18),
                                        -BRIDGED_FORCE_Q18, BRIDGED_FORCE_Q18);
    }
}

/* Counts samples in a row at the limit of a sensor. At their end returns n^4 times the square of a slope,
 * else 0. The part beyond the limit is taken for a parabola that begins with the larger slope of both ends;
 * its integral is time^2 slope / 6. The true part lies between 0 and that, with a variance of a third of its
 * square. now: of this step; sixth: a sixth of the step before. The slope here is a sixth of their
 * difference, so its square is 1/36 of the true one. */
static uint64_t unseen(uint8_t *run, uint32_t *slope, bool clipped, const int32_t now[3],
                       const int32_t sixth[3]) {
    const uint32_t steps = *run;
    if (clipped == (steps != 0U)) { /* the row goes on, or there is none */
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

/* A sample with rates alone: the acceleration is taken for 1 g upwards, which tells nothing about the tilt,
 * and with it the velocity of the block for unknown. */
SELDOM static void without_acceleration(plumb_attitude_t *c) {
    for (unsigned i = 0; i < 3U; i++) {
        c->words.accel_g_q25[i] = c->started ? asr32(c->words.up_q30[i], 5) : 0;
    }
    c->velocity_added_q26 = VELOCITY_ADDED_Q26;
}

SELDOM PART void plumb_attitude_count_clipped(plumb_attitude_t *c, const plumb_attitude_params_t *a,
                                              uint32_t flags, const int32_t half[3]) {
    if (flags == PLUMB_ATTITUDE_FLAG_MISSING) {
        return;
    }
    const int32_t *const raw = &c->words.raw[3];
    if ((flags & PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED) != 0U &&
        (raw[0] + raw[1] + raw[2] == NO_FORCE || c->accel_clipped_steps >= 2U * (uint32_t)a->block_steps)) {
        without_acceleration(c);
    }
    if (!c->started) {
        return;
    }
    const uint64_t turned = unseen(&c->gyro_clipped_steps, &c->gyro_slope_q32,
                                   (flags & PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED) != 0U, half, c->half_sixth_q32);
    const uint64_t forced =
        unseen(&c->accel_clipped_steps, &c->accel_slope_q18,
               (flags & PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED) != 0U, c->words.accel_g_q25, c->accel_sixth_q25);
    const uint32_t thrice_q32 = limited(turned, VARIANCE_LIMIT_Q32) * 4U;
    plumb_attitude_add_limited(&c->tilt_added_q32, thrice_q32 / 3U, VARIANCE_LIMIT_Q32);
    if (forced == 0U) {
        return;
    }
    const uint64_t force_q8 = forced >> 10 < 1ULL << 40 ? forced >> 10 : 1ULL << 40;
    const uint64_t square_q26 = force_q8 * mulhi_u32(a->dt_s_q33, a->dt_s_q33) >> 16;
    plumb_attitude_add_limited(&c->velocity_added_q26, limited(square_q26, 3U * VELOCITY_ADDED_Q26) / 3U,
                               VELOCITY_ADDED_Q26);
}
