/* Tilt of one axis from the raw counts of a gyro and an accelerometer, on a PC. */
#include "samples.h"
#include <plumb/plumb.h>
#include <stdio.h>

int main(void) {
    plumb_quad_tuning_t tuning = PLUMB_QUAD_TUNING_DEFAULT; /* deg, deg/s, g, s: change what you need */
    tuning.period_us = 20000;
    tuning.start.p00_deg2 = 100.0;

    plumb_params_t params;
    const plumb_design_t made = plumb_quad_design(&tuning, &params);
    if (made.error != PLUMB_DESIGN_OK) {
        fprintf(stderr, "%s = %g is refused\n", made.field, made.asked);
        return 1;
    }

    plumb_quad_t axis;
    plumb_quad_init(&axis, &params);
    for (int i = 0; i < SAMPLES; i++) {
        const int16_t raw[PLUMB_RAW_MAX] = {samples[i][0], samples[i][1], samples[i][2]};
        plumb_quad_step(&axis, &params, raw, 0);
        /* 2^32 is a turn */
        const long tilt_mdeg = (long)((int64_t)axis.words.tilt_turn_q32 * 360000 / 4294967296);
        printf("step %d  tilt %ld mdeg\n", i + 1, tilt_mdeg);
    }
    return 0;
}
