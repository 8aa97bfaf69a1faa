#include "plumb/attitude.h"
#include "core/axis.h"
#include "core/calibration.h"
#include "core/error_filter.h"
#include "plumb/mounting.h"

#include "attitude_block.h"
#include "attitude_gaps.h"
#include "attitude_start.h"
#include "attitude_travel.h"
#include "attitude_turns.h"

#define WORTHLESS_G_Q25      5033165      /* 0.15 g: below it an acceleration tells no direction */
#define LONGEST_BLOCK_S_Q33  2731598643U  /* 0.318 s: no sum of a block overflows */
#define MOST_HALF_ANGLES_Q34 (1ULL << 34) /* block_steps * half_angle: half angles of a block below 8 rad */
#define CLIPPED              (PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED | PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED)

typedef char attitude_assert_size[sizeof(plumb_attitude_t) <= 768U ? 1 : -1];

void plumb_attitude_init(plumb_attitude_t *c, const plumb_params_t *p) {
    *c = (plumb_attitude_t){.words = {.attitude = {ONE_Q30, 0, 0, 0}, .up_q30 = {0, 0, ONE_Q30}}};
    c->carried_blocks = LANDED_BLOCKS;
    c->weight_g_q18 = 1 << 18;
    c->hover_q15 = p->attitude.aid_hover_q15;
    plumb_attitude_start(c, &p->attitude);
}

/* Turns rate and acceleration from the sensors' axes to the body's. */
SELDOM static uint32_t mount(const plumb_params_t *p, int32_t rate[3], int32_t accel[3]) {
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

void plumb_attitude_step(plumb_attitude_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint) {
    plumb_attitude_words_t *const w = &c->words;
    const plumb_attitude_params_t *const a = &p->attitude;
    axis_record_raw(w->raw, raw);
    w->thrust_q15 = setpoint;
    w->step++;

    /* Without a sample, rate and acceleration keep their values. After a gap the last step of a block takes
     * no sample: bridging the gap and closing the block are each the work of one step. */
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
    if (((flags & CLIPPED) | c->gyro_clipped_steps | c->accel_clipped_steps) != 0U) {
        plumb_attitude_count_clipped(c, a, flags, half);
    }
    const int32_t ax = w->accel_g_q25[0], ay = w->accel_g_q25[1], az = w->accel_g_q25[2];
    const bool bridged = c->gap_steps != 0U && flags != PLUMB_ATTITUDE_FLAG_MISSING;
    int32_t force_g_q20[3];
    if (bridged) {
        plumb_attitude_bridge(c, a, half, force_g_q20);
    }
    if (!c->started) {
        c->started = plumb_attitude_align(&w->attitude, asr32(ax, 1), asr32(ay, 1), asr32(az, 1),
                                          WORTHLESS_G_Q25 / 4U) >= WORTHLESS_G_Q25 / 4U;
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
    /* coning: the axis of rotation turns within the step (the same author, part 1) */
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
    c->energy_q24 += plumb_attitude_turn_body(&w->attitude, turn_x, turn_y, turn_z) >> 6;
    plumb_attitude_matrix_of(&w->attitude, m);
    if (bridged) {
        plumb_attitude_add_force(c, m, force_g_q20);
    }
    c->force_sum_q18[0] += asr32(along(m, fx, fy, fz), 5);
    c->force_sum_q18[1] += asr32(along(m + 3, fx, fy, fz), 5);
    c->force_sum_q18[2] += asr32(along(m + 6, fx, fy, fz), 5);
    if (a->aid_s_q24 != 0) { /* sums the acceleration along the body's z, which is thrust */
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

    bool turned = c->slice != SLICE_NONE && !bridged && plumb_attitude_compute_slice(c, a);
    if (++w->block_step == (uint32_t)a->block_steps) {
        turned |= plumb_attitude_close_block(c, a);
    }
    if (turned) {
        plumb_attitude_matrix_of(&w->attitude, m);
    }
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
