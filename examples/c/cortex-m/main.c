/* The same on a Cortex-M without an operating system: the parameters are worked out once, at the start. */
#include "../samples.h"
#include "console.h"
#include <plumb/plumb.h>

static plumb_params_t params;
static plumb_quad_t axis;

int main(void) {
    plumb_quad_tuning_t tuning = PLUMB_QUAD_TUNING_DEFAULT;
    tuning.period_us = 20000;
    tuning.start.p00_deg2 = 100.0;

    const plumb_design_t made = plumb_quad_design(&tuning, &params);
    if (made.error != PLUMB_DESIGN_OK) {
        console_text(made.field);
        return 1;
    }

    plumb_quad_init(&axis, &params);
    for (int i = 0; i < SAMPLES; i++) { /* here: once a period, from the sensor */
        const int16_t raw[PLUMB_RAW_MAX] = {samples[i][0], samples[i][1], samples[i][2]};
        plumb_quad_step(&axis, &params, raw, 0);
        console_text("step ");
        console_number(i + 1);
        console_text("  tilt ");
        console_number((int32_t)((int64_t)axis.words.tilt_turn_q32 * 360000 / 4294967296));
        console_text(" mdeg\n");
    }
    return 0;
}
