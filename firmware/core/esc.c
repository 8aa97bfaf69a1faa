#include "esc.h"
#include "fixed.h"

SELDOM_CALLED bool plumb_esc_valid(const plumb_esc_params_t *p) {
    return p->neutral_halfus >= ESC_PULSE_MIN_HALFUS && p->neutral_halfus <= ESC_NEUTRAL_MAX_HALFUS &&
           p->neutral_halfus <= p->min_halfus && p->min_halfus <= p->mid_halfus &&
           p->mid_halfus <= p->max_halfus && p->max_halfus <= ESC_PULSE_MAX_HALFUS &&
           p->span_halfus >= -ESC_SPAN_MAX_HALFUS && p->span_halfus <= ESC_SPAN_MAX_HALFUS;
}
