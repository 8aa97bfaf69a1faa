/* What a sensor's samples go through before they are fused: presence, spikes, noise.
 *
 *     counts of three axes -> missing or saturated? -> spike? -> calibration -> one-pole
 *
 * A count of PREFILTER_NO_SAMPLE on any axis says that this step has no sample of the sensor; a count outside
 * the calibration's range is a saturated sample, which is no sample either. A sample further than
 * spike_counts from the straight line through the two before it is a spike: the line's value stands for it,
 * once; a second such sample in a row is believed, for then it is the motion that has jumped. */
#ifndef PLUMB_CORE_PREFILTER_H
#define PLUMB_CORE_PREFILTER_H

#include "calibration.h"

#define PREFILTER_NO_SAMPLE (-32768)
#define PREFILTER_GAP_MAX   65535U /* a gap counts no further */

typedef struct {
    int32_t spike_counts; /* 1..2^17; the largest finds none */
    int32_t smooth_q16;   /* share of a new sample in the one-pole, 1..2^16; 2^16 is no filter */
} prefilter_params_t;

/* Of one sensor. */
typedef struct {
    int32_t last[3], before[3]; /* counts of the last two samples, spikes replaced */
    uint32_t spikes;            /* bit per axis: last[] stands for a spike */
    uint32_t gap_steps;         /* since the last sample; 0 in its own step */
} prefilter_t;

/* What a step gave; none of them: no sample. */
#define PREFILTER_SATURATED 0x01U
#define PREFILTER_SAMPLE    0x04U
#define PREFILTER_SPIKE     0x10U /* on some axis of it */

/* False if a word is outside its range. */
bool prefilter_valid(const prefilter_params_t *p);

/* No sample so far. */
void prefilter_init(prefilter_t *f);

/* One step of one sensor. raw: three counts. stale_steps: a gap longer than this makes the next sample the
 * first. value: calibrated and smoothed, of the last sample; changed by a sample only. Gives PREFILTER_*
 * bits. */
uint32_t prefilter_step(prefilter_t *f, const prefilter_params_t *p, const calibration_params_t *calibration,
                        const int32_t raw[3], uint32_t stale_steps, int32_t value[3]);

#endif
