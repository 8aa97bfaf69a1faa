#include "notch.h"
#include "core/fixed.h"

#define COUNT_MAX 4095
#define WHOLE_Q30 (1 << 30)
#define OUT_MAX   (1 << 26)

void plumb_notch_init(plumb_notch_t *c, const plumb_params_t *p) {
    (void)p;
    *c = (plumb_notch_t){0};
}

void plumb_notch_step(plumb_notch_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                      int32_t setpoint) {
    plumb_notch_words_t *w = &c->words;
    const int32_t count = clamp_i32(raw[0], 0, COUNT_MAX);
    /* counts times Q30, shifted to Q12: at most 2^12 2^30 2^12 a term */
    const int64_t in =
        mul_i64(p->notch.b0_q30, (count + c->in[1]) * 4096) + mul_i64(p->notch.b1_q30, c->in[0] * 4096);
    const int64_t fed = mul_i64(p->notch.b1_q30, c->out_q12[0]) + mul_i64(p->notch.a2_q30, c->out_q12[1]);
    const int32_t out = clamp_i32(sat_i32(asr64(in - fed, 30)), -OUT_MAX, OUT_MAX);

    for (unsigned i = 0; i < sizeof w->raw / sizeof w->raw[0]; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint = setpoint;
    w->filtered_counts_q12 = out;
    w->removed_counts_q12 = count * 4096 - out;
    w->flags = count == 0 || count == COUNT_MAX ? PLUMB_NOTCH_FLAG_CLAMPED : 0U;
    w->step++;
    c->in[1] = c->in[0];
    c->in[0] = count;
    c->out_q12[1] = c->out_q12[0];
    c->out_q12[0] = out;
}

bool plumb_notch_params_valid(const plumb_params_t *p) {
    return p->notch.b0_q30 >= 0 && p->notch.b0_q30 <= WHOLE_Q30 && p->notch.a2_q30 > -WHOLE_Q30 &&
           p->notch.a2_q30 < WHOLE_Q30;
}
