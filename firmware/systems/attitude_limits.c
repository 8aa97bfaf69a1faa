#include "attitude_limits.h"

SELDOM PART int32_t plumb_attitude_saturated(int64_t x) {
    return sat_i32(x);
}

SELDOM PART void plumb_attitude_add_limited(int32_t *variance, uint64_t by, uint32_t most) {
    *variance = (int32_t)min_u32((uint32_t)*variance + limited(by, most), most);
}
