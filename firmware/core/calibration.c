#include "calibration.h"

bool calibration_valid(const calibration_params_t *p) {
    const int64_t low = mul_i64(p->raw_min, p->gain) + p->offset;
    const int64_t high = mul_i64(p->raw_max, p->gain) + p->offset;
    return p->raw_min >= INT16_MIN && p->raw_min <= p->raw_max && p->raw_max <= INT16_MAX &&
           low >= -CALIBRATION_LIMIT && low <= CALIBRATION_LIMIT && high >= -CALIBRATION_LIMIT &&
           high <= CALIBRATION_LIMIT;
}
