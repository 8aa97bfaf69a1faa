/* Prefilter of a three-axis sensor: detects missing and saturated samples, replaces spikes, smooths.
 *
 *     counts of three axes -> missing or saturated? -> spike? -> calibration -> one-pole low-pass
 *
 * A count of PLUMB_PREFILTER_NO_SAMPLE on any axis means that the sensor has no sample in this step. A count
 * outside the calibration's range is a saturated sample, and treated as missing. A count further than
 * spike_counts from the straight line through the two before it is a spike: the value of the line replaces it
 * once. A second such sample in a row is accepted, because then the motion has jumped. */
#ifndef PLUMB_PREFILTER_H
#define PLUMB_PREFILTER_H

#include "plumb/calibration.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_PREFILTER_NO_SAMPLE (-32768)
#define PLUMB_PREFILTER_GAP_MAX   65535U /* steps; the count of a gap stops here */

/* Settings. */
typedef struct {
    int32_t spike_counts; /* 1..2^17; 2^17 detects none */
    int32_t smooth_q16;   /* weight of a new sample in the low-pass, 1..2^16; 2^16: no filter */
} plumb_prefilter_params_t;

/* State of one sensor. */
typedef struct {
    int32_t last[3], before[3]; /* counts of the last two samples, spikes replaced */
    uint32_t spikes;            /* bit per axis: last[] replaces a spike */
    uint32_t gap_steps;         /* since the last sample; 0 in its own step */
} plumb_prefilter_t;

/* Result of a step, as bits; 0: no sample. */
#define PLUMB_PREFILTER_SATURATED 0x01U
#define PLUMB_PREFILTER_SAMPLE    0x04U
#define PLUMB_PREFILTER_SPIKE     0x10U /* with PLUMB_PREFILTER_SAMPLE: a spike on at least one axis */

/* False if a word is outside its range. */
bool plumb_prefilter_valid(const plumb_prefilter_params_t *p);

/* No sample so far. */
void plumb_prefilter_init(plumb_prefilter_t *f);

/* One step of one sensor; returns PREFILTER_* bits. raw: three counts. stale_steps: after a longer gap the
 * next sample starts the filter anew. value: calibrated and smoothed; only a sample changes it. */
uint32_t plumb_prefilter_step(plumb_prefilter_t *f, const plumb_prefilter_params_t *p,
                              const plumb_calibration_params_t *calibration, const int32_t raw[3],
                              uint32_t stale_steps, int32_t value[3]);

#ifdef __cplusplus
}
#endif

#endif
