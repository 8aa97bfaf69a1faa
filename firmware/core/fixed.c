#include "fixed.h"

int32_t plumb_add_scaled_far(int32_t x, int64_t product, unsigned n) {
    return sat_i32(x + asr64(product, n));
}
