#include "wheels_doubt.h"

#define UP_LEAST   (1L << 25) /* g Q26: half */
#define APART_MOST (8L << 26) /* m/s Q26 */

PART_KERNEL bool plumb_wheels_is_odd(const plumb_wheels_words_t *w) {
    return (w->flags & (PLUMB_WHEELS_FLAG_ACCEL_X_CLAMPED | PLUMB_WHEELS_FLAG_ACCEL_Z_CLAMPED)) != 0U ||
           (w->phase != PLUMB_WHEELS_STOPPED && w->accel_z_g_q26 < UP_LEAST);
}

/* Steps since the last one with a count of a wheel, that one counted, up to the most; 0: none since it
 * drives. */
KERNEL uint32_t since_count(uint32_t steps, int32_t counts, uint32_t most) {
    return counts != 0 ? 1U : steps != 0U ? min_u32(steps + 1U, most) : 0U;
}

PART_KERNEL uint32_t plumb_wheels_doubt(plumb_wheels_words_t *w, const plumb_wheels_params_t *q, bool on,
                                        int32_t left, int32_t right, int32_t duty_max_q15) {
    const uint32_t kept = on ? w->flags & (PLUMB_WHEELS_FLAG_ENCODERS | PLUMB_WHEELS_FLAG_LIFTED) : 0U;
    if (!on || w->stop_reason != 0U) {
        w->apart_mps_q26 = 0;
        w->left_steps = w->right_steps = w->rocked_turnps_q28 = w->full_steps = 0U;
        return kept;
    }
    const int32_t felt = sub_wrap(w->tilt_measured_turn_q32, w->tilt_turn_q32);
    const int32_t faded = w->apart_mps_q26 - 2 * mulhi_i32(w->apart_mps_q26, q->apart_alpha_q31);
    const bool counts = (left | right) != 0;
    w->apart_mps_q26 = clamp_i32(faded - mulhi_i32(felt, q->felt_mps_q26), -APART_MOST, APART_MOST);
    w->left_steps = since_count(w->left_steps, left, q->dead_steps);
    w->right_steps = since_count(w->right_steps, right, q->dead_steps);
    const int32_t nearly = duty_max_q15 - asr32(duty_max_q15, 3);
    w->full_steps = in_a_row(w->full_steps, counts && (int32_t)abs_u32(w->duty_q15) >= nearly, q->full_steps);
    const uint32_t lifted = w->full_steps >= q->full_steps ? PLUMB_WHEELS_FLAG_LIFTED : 0U;
    if (counts) {
        w->rocked_turnps_q28 = 0U;
        return kept | lifted;
    }
    w->rocked_turnps_q28 = min_u32(w->rocked_turnps_q28 + abs_u32(w->rate_corrected_turnps_q28), ROCKED_MOST);
    const bool rocks = min_u32(w->left_steps, w->right_steps) >= q->dead_steps &&
                       w->rocked_turnps_q28 > q->rocked_turnps_q28;
    const bool moves = (w->left_steps | w->right_steps) == 0U &&
                       abs_u32(w->wheel.velocity_mps_q26 + w->apart_mps_q26) > (uint32_t)q->apart_max_mps_q26;
    return kept | lifted | (rocks || moves ? PLUMB_WHEELS_FLAG_ENCODERS : 0U);
}

PART_KERNEL uint32_t plumb_wheels_stopped_by(const plumb_wheels_words_t *w, uint32_t flags, bool on,
                                             bool blind) {
    const bool lie = (flags & (PLUMB_WHEELS_FLAG_ENCODERS | PLUMB_WHEELS_FLAG_LIFTED)) != 0U;
    const uint32_t idle = blind ? PLUMB_WHEELS_STOP_SENSORS : PLUMB_WHEELS_STOP_RIDER;
    return (on && w->phase == PLUMB_WHEELS_STOPPED ? idle : 0U) |
           ((flags & PLUMB_WHEELS_FLAG_FALLEN) != 0U ? PLUMB_WHEELS_STOP_FALLEN : 0U) |
           (on && lie ? PLUMB_WHEELS_STOP_SENSORS : 0U);
}

/* How far the speed of these counts is from one that is felt, m/s Q26. */
KERNEL uint32_t residual(const plumb_wheel_params_t *p, int32_t counts, int32_t felt) {
    return abs_u32(sub_wrap(clamp_i32(counts, -p->edges_max, p->edges_max) * p->edge_mps_q26, felt));
}

PART_KERNEL int32_t plumb_wheels_both(const plumb_wheels_words_t *w, const plumb_params_t *p, int32_t left,
                                      int32_t right) {
    const uint32_t dead = p->wheels.dead_steps;
    const bool one = (w->left_steps >= dead) != (w->right_steps >= dead);
    if (w->slip_steps == 0U && !one) {
        return left + right;
    }
    const int32_t turned = asr32(mulhi_i32(w->turn_rate_turnps_q28, p->wheels.turn_counts_q36) + 8, 4);
    const int32_t by_left = 2 * left + turned, by_right = 2 * right - turned;
    const int32_t felt = w->wheel.velocity_mps_q26 + w->apart_mps_q26;
    if (one) {
        return w->right_steps >= dead ? by_left : by_right;
    }
    return residual(&p->wheel, by_left, felt) <= residual(&p->wheel, by_right, felt) ? by_left : by_right;
}
