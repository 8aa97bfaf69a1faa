#include "current.h"
#include "core/fixed.h"

#define COUNT_MAX  4095
#define ASKED_MAX  (64 << 20) /* A Q20 */
#define FLOWING_A  (1 << 17)  /* 0.125 A Q20 */
#define OVER_STEPS 3U
#define OVER_LIMIT 1000U
#define WHOLE_Q30  (1 << 30)

void plumb_current_init(plumb_current_t *c, const plumb_params_t *p) {
    (void)p;
    *c = (plumb_current_t){0};
}

static int32_t magnitude(int32_t value) {
    return value < 0 ? -value : value;
}

void plumb_current_step(plumb_current_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                        int32_t setpoint_a_q20) {
    plumb_current_words_t *w = &c->words;
    const int32_t used = clamp_i32(raw[0], 0, COUNT_MAX);
    const int32_t most = p->current.duty_max_q15;

    for (unsigned i = 0; i < sizeof w->raw / sizeof w->raw[0]; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint_a_q20 = setpoint_a_q20;
    w->current_a_q20 = (used - p->current.zero_counts) * p->current.gain_a_q20;
    w->error_a_q20 = clamp_i32(setpoint_a_q20, -ASKED_MAX, ASKED_MAX) - w->current_a_q20;
    const int32_t risen =
        clamp_i32(sat_i32(asr64(mul_i64(p->current.ki_q30, w->error_a_q20), 20)), -WHOLE_Q30, WHOLE_Q30);
    w->integral_q30 = clamp_i32(w->integral_q30 + risen, -WHOLE_Q30 + 1, WHOLE_Q30 - 1);
    const int64_t duty = asr64(mul_i64(p->current.kp_q15, w->error_a_q20), 20) + asr32(w->integral_q30, 15);
    w->duty_q15 = clamp_i32(sat_i32(duty), -most, most);
    w->over_steps =
        magnitude(w->current_a_q20) > p->current.trip_a_q20 ? min_u32(w->over_steps + 1U, OVER_LIMIT) : 0U;
    w->flags = used == 0 || used == COUNT_MAX ? PLUMB_CURRENT_FLAG_CLAMPED : 0U;
    w->flags |= w->over_steps >= OVER_STEPS ? PLUMB_CURRENT_FLAG_OVER_CURRENT : 0U;
    w->flags |= magnitude(w->current_a_q20) > FLOWING_A ? PLUMB_CURRENT_FLAG_FLOWING : 0U;
    w->step++;
}

bool plumb_current_params_valid(const plumb_params_t *p) {
    return magnitude(p->current.gain_a_q20) <= 65536 && p->current.zero_counts >= 0 &&
           p->current.zero_counts <= COUNT_MAX && p->current.kp_q15 >= 0 && p->current.kp_q15 <= 1 << 20 &&
           p->current.ki_q30 >= 0 && p->current.ki_q30 <= WHOLE_Q30 && p->current.duty_max_q15 >= 0 &&
           p->current.duty_max_q15 <= 32767;
}
