#include "gantry.h"
#include "core/fixed.h"

#define SLIDES 3
#define FAR    (1 << 24)

/* Places of the commands among the inputs. */
#define Y      6
#define Z_LOW  7
#define Z_HIGH 8

void plumb_gantry_init(plumb_gantry_t *c, const plumb_params_t *p) {
    (void)p;
    *c = (plumb_gantry_t){0};
}

void plumb_gantry_step(plumb_gantry_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                       int32_t setpoint_x_counts) {
    plumb_gantry_words_t *w = &c->words;
    const uint32_t z = (uint32_t)(uint16_t)raw[Z_HIGH] << 16 | (uint16_t)raw[Z_LOW];
    const int32_t asked[SLIDES] = {setpoint_x_counts, raw[Y], wrap_i32(z)};
    const int32_t most = p->gantry.step_counts;
    bool arrived = true;

    for (unsigned i = 0; i < sizeof w->raw / sizeof w->raw[0]; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint_x_counts = setpoint_x_counts;
    for (unsigned i = 0; i < SLIDES; i++) {
        const int32_t left = clamp_i32(asked[i], -FAR, FAR) - w->path_counts[i];
        w->path_counts[i] += clamp_i32(left, -most, most);
        w->apart_counts[i] = w->path_counts[i] - raw[i];
        arrived = arrived && asked[i] == w->path_counts[i];
    }
    w->flags = arrived ? PLUMB_GANTRY_FLAG_ARRIVED : 0U;
    w->step++;
}

bool plumb_gantry_params_valid(const plumb_params_t *p) {
    return p->gantry.step_counts >= 1 && p->gantry.step_counts <= 32767;
}
