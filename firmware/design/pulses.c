/* Conversion of the pulses of speed controllers. */
#include "core/esc.h"
#include "groups.h"

/* A pulse in half-microseconds, within low to high. */
static int32_t pulse(plumb_design_t *d, const char *field, double asked_us, int32_t low, int32_t high) {
    const wide_t exact = wide_mul(wide_of(plumb_design_bounded(asked_us)), wide_of(2.0));
    if (exact.hi < (double)low || exact.hi > (double)high) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, asked_us, (double)low / 2.0,
                            (double)high / 2.0);
    }
    return (int32_t)plumb_design_whole(d, field, asked_us, exact, low, high);
}

static void in_order(plumb_design_t *d, const char *field, double asked_us, double above_us) {
    if (asked_us > above_us) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, field, asked_us, ESC_PULSE_MIN_HALFUS / 2.0,
                            above_us);
    }
}

void plumb_design_esc(plumb_design_t *d, const plumb_esc_tuning_t *t, plumb_esc_params_t *words) {
    const int32_t low = ESC_PULSE_MIN_HALFUS, high = ESC_PULSE_MAX_HALFUS, span = ESC_SPAN_MAX_HALFUS;
    words->mid_halfus = pulse(d, "esc.mid_us", t->mid_us, low, high);
    words->span_halfus = pulse(d, "esc.span_us", t->span_us, -span, span);
    words->min_halfus = pulse(d, "esc.min_us", t->min_us, low, high);
    words->max_halfus = pulse(d, "esc.max_us", t->max_us, low, high);
    words->neutral_halfus = pulse(d, "esc.neutral_us", t->neutral_us, low, ESC_OFF_MAX_HALFUS);
    in_order(d, "esc.neutral_us", t->neutral_us, t->min_us);
    in_order(d, "esc.min_us", t->min_us, t->mid_us);
    in_order(d, "esc.mid_us", t->mid_us, t->max_us);
}
