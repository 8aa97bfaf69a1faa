#include "plumb/prefilter.h"
#include "calibration.h"

SELDOM_CALLED bool plumb_prefilter_valid(const plumb_prefilter_params_t *p) {
    return p->spike_counts >= 1 && p->spike_counts <= 1 << 17 && p->smooth_q16 >= 1 &&
           p->smooth_q16 <= 1 << 16;
}

SELDOM_CALLED void plumb_prefilter_init(plumb_prefilter_t *f) {
    *f = (plumb_prefilter_t){.gap_steps = PLUMB_PREFILTER_GAP_MAX};
}

/* PLUMB_PREFILTER_SAMPLE; PLUMB_PREFILTER_SATURATED with a count outside the range; 0 when a count is
 * missing. */
static uint32_t presence(const plumb_calibration_params_t *calibration, const int32_t raw[3]) {
    uint32_t result = PLUMB_PREFILTER_SAMPLE;
    for (unsigned i = 0; i < 3U; i++) {
        if (raw[i] == PLUMB_PREFILTER_NO_SAMPLE) {
            return 0;
        }
        if (calibration_clamp(calibration, raw[i]) != raw[i]) {
            result = PLUMB_PREFILTER_SATURATED;
        }
    }
    return result;
}

uint32_t plumb_prefilter_step(plumb_prefilter_t *f, const plumb_prefilter_params_t *p,
                              const plumb_calibration_params_t *calibration, const int32_t raw[3],
                              uint32_t stale_steps, int32_t value[3]) {
    const uint32_t result = presence(calibration, raw);
    if (result != PLUMB_PREFILTER_SAMPLE) {
        f->gap_steps += f->gap_steps < PLUMB_PREFILTER_GAP_MAX;
        return result;
    }
    const bool fresh = f->gap_steps > stale_steps;
    uint32_t spikes = 0;
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t line = 2 * f->last[i] - f->before[i];
        const bool was_spike = (f->spikes >> i & 1U) != 0U;
        const bool off = abs_u32(raw[i] - line) > (uint32_t)p->spike_counts;
        const bool spike = !fresh && !was_spike && off;
        f->before[i] = fresh || (was_spike && off) ? raw[i] : f->last[i];
        f->last[i] = spike ? calibration_clamp(calibration, line) : raw[i];
        spikes |= (uint32_t)spike << i;
        const int32_t now = calibration_scale(calibration, f->last[i]);
        const int64_t change = sub64_wrap(now, value[i]);
        value[i] = fresh ? now : wrap_i32((uint32_t)(value[i] + asr64(change * p->smooth_q16, 16)));
    }
    f->spikes = spikes;
    f->gap_steps = 0;
    return spikes != 0U ? PLUMB_PREFILTER_SAMPLE | PLUMB_PREFILTER_SPIKE : PLUMB_PREFILTER_SAMPLE;
}
