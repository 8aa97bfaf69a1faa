#include "calibration.h"

SELDOM_CALLED bool plumb_calibration_valid(const plumb_calibration_params_t *p) {
    const int64_t low = mul_i64(p->raw_min, p->gain) + p->offset;
    const int64_t high = mul_i64(p->raw_max, p->gain) + p->offset;
    return p->raw_min >= INT16_MIN && p->raw_min <= p->raw_max && p->raw_max <= INT16_MAX &&
           low >= -PLUMB_CALIBRATION_LIMIT && low <= PLUMB_CALIBRATION_LIMIT &&
           high >= -PLUMB_CALIBRATION_LIMIT && high <= PLUMB_CALIBRATION_LIMIT;
}
