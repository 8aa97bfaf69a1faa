#include "toy.h"
#include "core/fixed.h"

void plumb_toy_init(plumb_toy_t *c, const plumb_params_t *p) {
    (void)p;
    *c = (plumb_toy_t){0};
}

void plumb_toy_step(plumb_toy_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                    int32_t setpoint) {
    plumb_toy_words_t *w = &c->words;
    const int32_t used = clamp_i32(raw[0], 0, p->toy.raw_max);
    const int32_t apart = sub_wrap(used * 65536, w->filtered_counts_q16);

    for (unsigned i = 0; i < PLUMB_RAW_MAX; i++)
        w->raw[i] = raw[i];
    w->setpoint_counts_q16 = setpoint;
    w->filtered_counts_q16 += (int32_t)asr64(mul_i64(apart, p->toy.share_q16), 16);
    w->error_counts_q16 = sub_wrap(setpoint, w->filtered_counts_q16);
    w->flags = used != raw[0] ? PLUMB_TOY_FLAG_CLAMPED : 0U;
    w->clamped_steps += w->flags;
    w->step++;
}

bool plumb_toy_params_valid(const plumb_params_t *p) {
    return p->toy.dt_s_q32 >= 1 && p->toy.raw_max >= 0 && p->toy.raw_max <= 32767 && p->toy.share_q16 >= 1 &&
           p->toy.share_q16 <= 65536;
}
