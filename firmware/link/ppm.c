#include "ppm.h"

#define WHOLE   (PPM_CHANNELS + 1U)
#define DAMAGED (PPM_CHANNELS + 2U)

static void edge(ppm_t *p, uint16_t stamp_us) {
    const uint16_t pulse_us = (uint16_t)(stamp_us - p->last_us);
    const bool fits =
        p->edges == 0U || (p->edges < WHOLE && pulse_us >= PPM_PULSE_MIN && pulse_us <= PPM_PULSE_MAX);

    if (p->edges > 0U && fits) {
        p->pulse_us[p->edges - 1U] = pulse_us;
    }
    p->edges = (uint8_t)(fits ? p->edges + 1U : DAMAGED);
    p->last_us = stamp_us;
}

bool ppm_follow(ppm_t *p, const uint16_t *stamps_us, size_t count, uint32_t now_us) {
    for (size_t i = 0; i < count; i++) {
        edge(p, stamps_us[i]);
        p->received_us = now_us;
    }
    if (count > 0U || now_us - p->received_us <= PPM_PAUSE_US) {
        return false;
    }
    const bool whole = p->edges == WHOLE;

    p->edges = 0;
    return whole;
}
