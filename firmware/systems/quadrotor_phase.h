/* The phase of a quadrotor, from the receiver's frames and from conditions that last. Included by quadrotor.c
 * alone. */
#ifndef PLUMB_SYSTEMS_QUADROTOR_PHASE_H
#define PLUMB_SYSTEMS_QUADROTOR_PHASE_H

#include "core/fixed.h"
#include "plumb/quadrotor.h"

#define STEPS_MOST       65535U
#define QUIET_MIN_Q18    167772 /* (0.8 g)^2 */
#define QUIET_MAX_Q18    377487 /* (1.2 g)^2 */
#define QUIET_TURNS2_Q24 51782U /* (20 deg/s)^2 */

/* Steps for which a condition has been met without a break. */
KERNEL void count(uint32_t *steps, bool met) {
    *steps = met ? min_u32(*steps + 1U, STEPS_MOST) : 0U;
}

/* True while the receiver is lost. */
KERNEL bool listen(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q, int32_t receiver) {
    const uint32_t number = (uint32_t)receiver & PLUMB_QUADROTOR_NUMBER_MASK;
    count(&w->age_steps, number != 0U && number == w->receiver_number);
    w->receiver_number = number;
    const bool lost =
        number != 0U && ((receiver & PLUMB_QUADROTOR_FAILSAFE) != 0 || w->age_steps >= q->lost_steps);
    w->good_steps = lost ? 0U : min_u32(w->good_steps + 1U, q->back_steps);
    return lost;
}

/* True when the vehicle lies on its back at rest: after a crash. */
KERNEL bool lies(const plumb_quadrotor_words_t *w, const int32_t accel_g_q25[3]) {
    const int32_t ax = accel_g_q25[0], ay = accel_g_q25[1], az = accel_g_q25[2];
    const int32_t length = mulhi_i32(ax, ax) + mulhi_i32(ay, ay) + mulhi_i32(az, az);
    const int32_t rx = w->rate_turnps_q28[0], ry = w->rate_turnps_q28[1], rz = w->rate_turnps_q28[2];
    const uint32_t turning =
        (uint32_t)mulhi_i32(rx, rx) + (uint32_t)mulhi_i32(ry, ry) + (uint32_t)mulhi_i32(rz, rz);
    return w->up_q30[2] < 0 && length >= QUIET_MIN_Q18 && length <= QUIET_MAX_Q18 &&
           turning < QUIET_TURNS2_Q24;
}

/* Reason why the rotors must stop in any phase; 0: none. */
KERNEL uint32_t reason_to_stop(const plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                               bool unsure_on_ground) {
    return w->blind_steps >= q->blind_steps   ? PLUMB_QUADROTOR_STOPPED_BLIND
           : w->lying_steps >= q->lying_limit ? PLUMB_QUADROTOR_STOPPED_LYING
           : w->idle_steps >= q->idle_limit   ? PLUMB_QUADROTOR_STOPPED_IDLE
           : unsure_on_ground                 ? PLUMB_QUADROTOR_STOPPED_UNSURE
                                              : 0U;
}

/* The next phase. STOPPED although reason_to_stop() is 0 means that the receiver is lost. */
KERNEL uint32_t next_phase(const plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q, bool lost,
                           bool airborne) {
    switch (w->phase) {
    case PLUMB_QUADROTOR_FLOWN:
        return !lost ? PLUMB_QUADROTOR_FLOWN : airborne ? PLUMB_QUADROTOR_HELD : PLUMB_QUADROTOR_STOPPED;
    case PLUMB_QUADROTOR_HELD:
        if (!lost)
            return PLUMB_QUADROTOR_FLOWN;
        if (!airborne)
            return PLUMB_QUADROTOR_STOPPED;
        if (w->phase_steps <= q->held_steps)
            return PLUMB_QUADROTOR_HELD;
        return q->lost_action != 0U ? PLUMB_QUADROTOR_LANDING : PLUMB_QUADROTOR_STOPPED;
    default: /* landing */
        if (w->good_steps >= q->back_steps)
            return PLUMB_QUADROTOR_FLOWN;
        return airborne && w->phase_steps <= q->land_steps ? PLUMB_QUADROTOR_LANDING
                                                           : PLUMB_QUADROTOR_STOPPED;
    }
}

KERNEL void decide(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q, bool on, bool lost,
                   bool airborne, bool unsure) {
    const uint32_t before = w->phase, why = reason_to_stop(w, q, unsure && !airborne);
    w->phase_steps = min_u32(w->phase_steps + 1U, STEPS_MOST);
    if (!on) {
        w->phase = PLUMB_QUADROTOR_FLOWN;
        w->stop_reason = 0U;
    } else if (before != PLUMB_QUADROTOR_STOPPED) {
        w->phase = why != 0U ? PLUMB_QUADROTOR_STOPPED : next_phase(w, q, lost, airborne);
        if (w->phase == PLUMB_QUADROTOR_STOPPED)
            w->stop_reason = why != 0U ? why : PLUMB_QUADROTOR_STOPPED_RECEIVER;
    }
    if (w->phase != before)
        w->phase_steps = 0U;
}

#endif
