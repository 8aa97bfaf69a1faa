#include "toy.h"
#include "core/fixed.h"

/* Places of the commands among the inputs: words of 16 bits, the low half of the heading first. */
#define GAIN         9
#define HEADING_LOW  10
#define HEADING_HIGH 11
#define TRIM         12
#define HOLD         13
#define MODE         14

#define WHEELS_END 5
#define COUNTS_END 9

void plumb_toy_init(plumb_toy_t *c, const plumb_params_t *p) {
    (void)p;
    *c = (plumb_toy_t){0};
}

void plumb_toy_step(plumb_toy_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                    int32_t setpoint) {
    plumb_toy_words_t *w = &c->words;
    const int32_t used = clamp_i32(raw[0], 0, p->toy.raw_max);
    const int32_t apart = raw[HOLD] != 0 ? 0 : sub_wrap(used * 65536, w->filtered_counts_q16);
    const int end = raw[MODE] == 0 ? 1 : (raw[MODE] == 1 ? WHEELS_END : COUNTS_END);
    const uint32_t heading = (uint32_t)(uint16_t)raw[HEADING_HIGH] << 16 | (uint16_t)raw[HEADING_LOW];
    int32_t total = 0;

    for (unsigned i = 0; i < sizeof w->raw / sizeof w->raw[0]; i++) {
        w->raw[i] = raw[i];
    }
    for (int i = 1; i < end; i++) {
        total += raw[i];
    }
    w->total_counts = raw[GAIN] * total;
    w->heading_turn_q32 = (int32_t)(heading + (uint32_t)raw[TRIM] * 65536U);
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
