#include "plumb/quadrotor.h"
#include "core/esc.h"
#include "core/fixed.h"
#include "core/rate_loop.h"
#include "generated/ranges.h"
#include "quadrotor_mixer.h"
#include "quadrotor_phase.h"

/* Commands behind the counts. */
enum { ROLL = 6, PITCH, YAW, SWITCHES, RECEIVER };

#define TAKEOFF_AT(word) (uint8_t)(offsetof(plumb_quadrotor_words_t, word) / 4U)

#define INPUTS (sizeof((plumb_quadrotor_words_t *)0)->raw / sizeof(int32_t))

/* Copies the words of attitude that the control of the vehicle uses. */
KERNEL void take_attitude(plumb_quadrotor_words_t *w, const plumb_attitude_words_t *a) {
    for (unsigned i = 0; i < 3U; i++) {
        w->rate_turnps_q28[i] = a->rate_turnps_q28[i];
        w->up_q30[i] = a->up_q30[i];
    }
    w->attitude = a->attitude;
    w->tilt_variance_rad2_q32 = a->tilt_variance_rad2_q32;
}

/* Copies what attitude knows of the flight. */
KERNEL void take_flight(plumb_quadrotor_words_t *w, const plumb_attitude_t *a) {
    w->hover_q15 = a->hover_q15;
    w->climb_gs_q28 = a->climb_gs_q28;
    w->carried_blocks = a->carried_blocks;
}

/* Thrust command of the step before, Q15, without what roll and pitch add to it; 0: the rotors are off. A
 * vehicle that lies on its side gives full commands of roll with the throttle low, and does not hover. */
KERNEL int32_t collective(const plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q) {
    const bool flies = (w->flags & PLUMB_QUADROTOR_FLAG_FLIES) != 0U;
    return flies ? max_i32(max_i32(w->throttle_q15, asr32(q->idle_q24, 9)), 1) : 0;
}

SELDOM_CALLED void plumb_quadrotor_init(plumb_quadrotor_t *c, const plumb_params_t *p) {
    *c = (plumb_quadrotor_t){0};
    plumb_attitude_init(&c->attitude, p);
    c->attitude.vehicle = true;
    take_attitude(&c->words, &c->attitude.words);
    take_flight(&c->words, &c->attitude);
    c->words.phase = PLUMB_QUADROTOR_STOPPED; /* until the rotors are seen switched off */
}

/* The flags of attitude that this system has, too. */
KERNEL uint32_t taken_flags(uint32_t of_attitude) {
    return ((of_attitude & PLUMB_ATTITUDE_FLAG_GYRO_CLIPPED) != 0U ? PLUMB_QUADROTOR_FLAG_GYRO_CLIPPED : 0U) |
           ((of_attitude & PLUMB_ATTITUDE_FLAG_ACCEL_CLIPPED) != 0U ? PLUMB_QUADROTOR_FLAG_ACCEL_CLIPPED
                                                                    : 0U) |
           ((of_attitude & PLUMB_ATTITUDE_FLAG_MISSING) != 0U ? PLUMB_QUADROTOR_FLAG_MISSING : 0U) |
           ((of_attitude & PLUMB_ATTITUDE_FLAG_UNSURE) != 0U ? PLUMB_QUADROTOR_FLAG_UNSURE : 0U);
}

void plumb_quadrotor_step(plumb_quadrotor_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                          int32_t setpoint) {
    plumb_quadrotor_words_t *const w = &c->words;
    const plumb_quadrotor_params_t *const q = &p->quadrotor;
    for (unsigned i = 0; i < INPUTS; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint_throttle_q15 = setpoint;
    w->step++;

    plumb_attitude_step(&c->attitude, p, raw, collective(w, q));
    take_attitude(w, &c->attitude.words);
    take_flight(w, &c->attitude);
    const bool airborne = w->carried_blocks < PLUMB_ATTITUDE_MAYBE_LANDED_BLOCKS;
    const bool landed = w->carried_blocks == PLUMB_ATTITUDE_LANDED_BLOCKS;
    uint32_t flags = taken_flags(c->attitude.words.flags) | (airborne ? PLUMB_QUADROTOR_FLAG_AIRBORNE : 0U) |
                     (landed ? PLUMB_QUADROTOR_FLAG_LANDED : 0U);
    const bool unsure = (flags & PLUMB_QUADROTOR_FLAG_UNSURE) != 0U;

    const int32_t given = clamp_i32(setpoint, 0, INT16_MAX);
    const bool on = (raw[SWITCHES] & PLUMB_QUADROTOR_ROTORS_ON) != 0;
    const bool by_rate = (raw[SWITCHES] & PLUMB_QUADROTOR_MODE_RATE) != 0;
    const bool low = on && given < q->low_q15;
    const bool lost = plumb_quadrotor_listen(w, q, raw[RECEIVER]);
    count(&w->blind_steps, (flags & PLUMB_QUADROTOR_FLAG_MISSING) != 0U);
    count(&w->idle_steps, low && !airborne);
    count(&w->lying_steps, low && !by_rate && plumb_quadrotor_lies(w, c->attitude.words.accel_g_q25));
    count(&w->upturned_steps, on && w->up_q30[2] < 0 && (!by_rate || w->phase != PLUMB_QUADROTOR_FLOWN));
    plumb_quadrotor_watch_runaway(w, low, landed || c->attitude.flown_blocks < WATCHED_BLOCKS);
    plumb_quadrotor_decide(w, q, on, lost, landed, unsure);

    const bool flies = on && w->phase != PLUMB_QUADROTOR_STOPPED;
    const bool alone = w->phase == PLUMB_QUADROTOR_HELD || w->phase == PLUMB_QUADROTOR_LANDING;
    const bool levels = alone || !by_rate;
    const int32_t sticks[3] = {alone ? 0 : raw[ROLL], alone ? 0 : raw[PITCH], alone ? 0 : raw[YAW]};
    plumb_quadrotor_set_throttle(w, q, given, c->attitude.words.block_step == 0U);
    plumb_quadrotor_ask(w, q, sticks, levels,
                        unsure ? min_i32(q->tilt_rate_max_q28, q->unsure_rate_q28) : q->tilt_rate_max_q28);

    const rate_loop_mode_t mode = !flies                                ? RATE_LOOP_OFF
                                  : landed                              ? RATE_LOOP_GROUNDED
                                  : w->carried_blocks >= TOUCHED_BLOCKS ? RATE_LOOP_HELD
                                                                        : RATE_LOOP_FLYING;
    const int32_t alpha = q->d_alpha_q31, most = q->integral_max_q30;
    rate_loop_step(&w->roll, &p->rate_roll, alpha, most, w->asked_turnps_q28[0], w->rate_turnps_q28[0], mode);
    rate_loop_step(&w->pitch, &p->rate_pitch, alpha, most, w->asked_turnps_q28[1], w->rate_turnps_q28[1],
                   mode);
    rate_loop_step(&w->yaw, &p->rate_yaw, alpha, most, w->asked_turnps_q28[2], w->rate_turnps_q28[2], mode);

    flags |= (levels ? PLUMB_QUADROTOR_FLAG_LEVELS : 0U) | (lost ? PLUMB_QUADROTOR_FLAG_LOST : 0U);
    if (flies) {
        flags |= PLUMB_QUADROTOR_FLAG_FLIES | plumb_quadrotor_mix(w, q, &p->esc, q->airmode != 0U && !landed);
    } else {
        plumb_quadrotor_rest(w, &p->esc);
    }
    w->flags = flags;
}

/* Held in the hand it is not still enough; on a slope of 25 deg it may stand. Sigma is that of both axes. */
const plumb_takeoff_bounds_t plumb_quadrotor_takeoff = {
    .throttle = TAKEOFF_AT(setpoint_throttle_q15),
    .rate = TAKEOFF_AT(rate_turnps_q28),
    .up_z = TAKEOFF_AT(up_q30[2]),
    .variance = TAKEOFF_AT(tilt_variance_rad2_q32),
    .flags = TAKEOFF_AT(flags),
    .stopped = TAKEOFF_AT(stop_reason),
    .blind =
        PLUMB_QUADROTOR_FLAG_GYRO_CLIPPED | PLUMB_QUADROTOR_FLAG_ACCEL_CLIPPED | PLUMB_QUADROTOR_FLAG_MISSING,
    .stands = PLUMB_QUADROTOR_FLAG_LANDED,
    .throttle_max_q15 = 1638,          /* 5 % */
    .rest_turnps_q28 = 3728270U,       /* 5 deg/s */
    .up_z_min_q30 = 973140576,         /* cosine of 25 deg */
    .variance_max_rad2_q32 = 11774897U /* (3 deg)^2 */
};

SELDOM_CALLED bool plumb_quadrotor_params_valid(const plumb_params_t *p) {
    return plumb_attitude_params_valid(p) && plumb_esc_valid(&p->esc) && quadrotor_in_range(&p->quadrotor) &&
           plumb_rate_loop_valid(&p->rate_roll) && plumb_rate_loop_valid(&p->rate_pitch) &&
           plumb_rate_loop_valid(&p->rate_yaw);
}
