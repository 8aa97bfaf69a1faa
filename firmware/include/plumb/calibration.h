/* Raw counts -> units: clamp to the sensor's plausible range, scale, shift. One multiply-add of 32 bits.
 *
 *     value = gain * count + offset      count within raw_min..raw_max, or else saturated
 *
 * Gain and offset carry the unit: turn/s Q28 per count for a gyro, g Q26 per count for an accelerometer. */
#ifndef PLUMB_CALIBRATION_H
#define PLUMB_CALIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_CALIBRATION_LIMIT 1879048192L /* 7 * 2^28, of every calibrated value: 7 turn/s, 28 g */

/* Of one channel. */
typedef struct {
    int32_t raw_min; /* counts, -32768..32767 */
    int32_t raw_max; /* counts, raw_min..32767 */
    int32_t gain;    /* units per count */
    int32_t offset;  /* units at raw = 0 */
} plumb_calibration_params_t;

/* The calibrated value of a count. *clamped becomes true when the count was outside the range, and stays as
 * it is otherwise, so that several channels may share it. */
int32_t plumb_calibration_apply(const plumb_calibration_params_t *p, int32_t raw, bool *clamped);

/* False if the range is empty or leaves int16, or if a value could leave +-PLUMB_CALIBRATION_LIMIT. */
bool plumb_calibration_valid(const plumb_calibration_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
