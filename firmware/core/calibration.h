/* Raw counts to physical units: one multiply-add per channel. */
#ifndef PLUMB_CORE_CALIBRATION_H
#define PLUMB_CORE_CALIBRATION_H

#include <stdint.h>

/* value = clamp(raw, raw_min, raw_max) * gain + offset, in the channel's own format (rate: turn/s Q28,
 * acceleration: g Q26). The host makes sure, and control_params_valid() checks, that the value cannot leave
 * its range. */
typedef struct {
    int32_t gain;    /* units per count */
    int32_t offset;  /* units at raw 0 */
    int32_t raw_min; /* -32768 .. raw_max */
    int32_t raw_max; /* .. 32767 */
} calibration_t;

/* Clamp a count to the channel's range; sets flag in *saturated when that changed it. */
int32_t calibration_clamp(const calibration_t *c, int32_t raw, uint32_t flag, uint32_t *saturated);

/* The physical value of a clamped count. */
int32_t calibration_apply(const calibration_t *c, int32_t clamped);

#endif
