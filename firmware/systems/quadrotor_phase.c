#include "quadrotor_phase.h"

#define QUIET_MIN_Q18    167772    /* (0.8 g)^2 */
#define QUIET_MAX_Q18    377487    /* (1.2 g)^2 */
#define QUIET_TURNS2_Q24 51782U    /* (20 deg/s)^2 */
#define RUNAWAY_RATE_Q28 44739243U /* 60 deg/s */
#define UPRIGHT_Q30      (1 << 29) /* cosine of 60 deg */
#define TOUCHDOWN_BLOCKS 20U       /* of a landing: carried for so long, with the rotors idle at the end */
#define DESCENT_Q28      (1 << 28)

PART_KERNEL bool plumb_quadrotor_listen(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                        int32_t receiver) {
    const uint32_t number = (uint32_t)receiver & PLUMB_QUADROTOR_NUMBER_MASK;
    count(&w->age_steps, number != 0U && number == w->receiver_number);
    w->receiver_number = number;
    const bool lost =
        number != 0U && ((receiver & PLUMB_QUADROTOR_FAILSAFE) != 0 || w->age_steps >= q->lost_steps);
    w->good_steps = lost ? 0U : min_u32(w->good_steps + 1U, q->back_steps);
    return lost;
}

PART_KERNEL bool plumb_quadrotor_lies(const plumb_quadrotor_words_t *w, const int32_t accel_g_q25[3]) {
    const int32_t ax = accel_g_q25[0], ay = accel_g_q25[1], az = accel_g_q25[2];
    const int32_t length = mulhi_i32(ax, ax) + mulhi_i32(ay, ay) + mulhi_i32(az, az);
    const int32_t rx = w->rate_turnps_q28[0], ry = w->rate_turnps_q28[1], rz = w->rate_turnps_q28[2];
    const uint32_t turning =
        (uint32_t)mulhi_i32(rx, rx) + (uint32_t)mulhi_i32(ry, ry) + (uint32_t)mulhi_i32(rz, rz);
    return w->up_q30[2] < UPRIGHT_Q30 && length >= QUIET_MIN_Q18 && length <= QUIET_MAX_Q18 &&
           turning < QUIET_TURNS2_Q24;
}

/* True when the rate of an axis grows against the command of the step before. */
KERNEL bool grows_against(const plumb_rate_loop_t *loop, int32_t rate_turnps_q28) {
    const int32_t grown = sub_wrap(asr32(rate_turnps_q28, 1), loop->rate_filtered_turnps_q27);
    return abs_u32(rate_turnps_q28) > RUNAWAY_RATE_Q28 && (loop->demand_q24 ^ rate_turnps_q28) < 0 &&
           (grown ^ rate_turnps_q28) >= 0;
}

PART_KERNEL void plumb_quadrotor_watch_runaway(plumb_quadrotor_words_t *w, bool low, bool watched) {
    const bool limited = !low && (w->flags & PLUMB_QUADROTOR_FLAG_TILT_LIMITED) != 0U;
    if (!watched) {
        w->runaway_steps = 0U;
    } else if (limited && (grows_against(&w->roll, w->rate_turnps_q28[0]) ||
                           grows_against(&w->pitch, w->rate_turnps_q28[1]))) {
        w->runaway_steps = min_u32(w->runaway_steps + 1U, STEPS_MOST);
    } else {
        w->runaway_steps -= w->runaway_steps != 0U ? 1U : 0U;
    }
}

/* Reason why the rotors must stop in any phase; 0: none. */
KERNEL uint32_t reason_to_stop(const plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                               bool landed, bool unsure) {
    return w->blind_steps >= q->blind_steps           ? PLUMB_QUADROTOR_STOPPED_BLIND
           : w->lying_steps >= q->lying_limit         ? PLUMB_QUADROTOR_STOPPED_LYING
           : landed && w->idle_steps >= q->idle_limit ? PLUMB_QUADROTOR_STOPPED_IDLE
           : landed && unsure                         ? PLUMB_QUADROTOR_STOPPED_UNSURE
           : w->runaway_steps >= q->runaway_limit     ? PLUMB_QUADROTOR_STOPPED_RUNAWAY
           : w->upturned_steps >= q->upturned_limit   ? PLUMB_QUADROTOR_STOPPED_UPTURNED
                                                      : 0U;
}

/* True when a landing has ended: the ground carries the vehicle although its rotors idle. A controlled
 * descent is too slow for the air to carry it. */
KERNEL bool has_touched_down(const plumb_quadrotor_words_t *w) {
    return w->carried_blocks >= TOUCHDOWN_BLOCKS && w->throttle_q15 == 0;
}

/* The next phase. STOPPED although reason_to_stop() is 0 means that the receiver is lost. */
KERNEL uint32_t next_phase(const plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q, bool lost,
                           bool landed) {
    switch (w->phase) {
    case PLUMB_QUADROTOR_FLOWN:
        return !lost ? PLUMB_QUADROTOR_FLOWN : landed ? PLUMB_QUADROTOR_STOPPED : PLUMB_QUADROTOR_HELD;
    case PLUMB_QUADROTOR_HELD:
        if (!lost) {
            return PLUMB_QUADROTOR_FLOWN;
        }
        if (landed) {
            return PLUMB_QUADROTOR_STOPPED;
        }
        if (w->phase_steps <= q->held_steps) {
            return PLUMB_QUADROTOR_HELD;
        }
        return q->lost_action != 0U ? PLUMB_QUADROTOR_LANDING : PLUMB_QUADROTOR_STOPPED;
    default: /* landing */
        if (w->good_steps >= q->back_steps) {
            return PLUMB_QUADROTOR_FLOWN;
        }
        return has_touched_down(w) || w->phase_steps > q->land_steps ? PLUMB_QUADROTOR_STOPPED
                                                                     : PLUMB_QUADROTOR_LANDING;
    }
}

PART_KERNEL void plumb_quadrotor_decide(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                        bool on, bool lost, bool landed, bool unsure) {
    const uint32_t before = w->phase, why = reason_to_stop(w, q, landed, unsure);
    w->phase_steps = min_u32(w->phase_steps + 1U, STEPS_MOST);
    if (!on) {
        w->phase = PLUMB_QUADROTOR_FLOWN;
        w->stop_reason = 0U;
    } else if (before != PLUMB_QUADROTOR_STOPPED) {
        w->phase = why != 0U ? PLUMB_QUADROTOR_STOPPED : next_phase(w, q, lost, landed);
        if (w->phase == PLUMB_QUADROTOR_STOPPED) {
            w->stop_reason = why != 0U ? why : PLUMB_QUADROTOR_STOPPED_RECEIVER;
        }
    }
    if (w->phase != before) {
        w->phase_steps = 0U;
    }
}

PART_KERNEL void plumb_quadrotor_set_throttle(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                              int32_t given_q15, bool block_ends) {
    const int32_t hover = w->hover_q15, most = hover + asr32(hover, 2);
    if (w->phase == PLUMB_QUADROTOR_HELD) {
        w->throttle_q15 = min_i32(w->throttle_q15, hover);
    } else if (w->phase != PLUMB_QUADROTOR_LANDING) {
        w->throttle_q15 = given_q15;
    } else if (w->phase_steps == 0U) {
        if (w->carried_blocks < TOUCHED_BLOCKS) {
            w->throttle_q15 = hover;
        }
        w->landing_q15 = w->throttle_q15;
    } else if (block_ends) {
        const int32_t off = clamp_i32(-q->land_gs_q28 - w->climb_gs_q28, -DESCENT_Q28, DESCENT_Q28);
        const bool touches = w->carried_blocks >= PLUMB_ATTITUDE_MAYBE_LANDED_BLOCKS;
        const int32_t by = touches ? -asr32(hover, 2) : mulhi_i32(off, 3 * hover);
        w->landing_q15 = clamp_i32(w->landing_q15 + by, 0, most);
        w->throttle_q15 =
            touches ? w->landing_q15 : clamp_i32(w->landing_q15 + mulhi_i32(off, 24 * hover), 0, most);
    }
}
