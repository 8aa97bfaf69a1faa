#include "fixed.h"

int64_t mul_shift(int64_t a, int32_t b, unsigned n) {
    const uint64_t high = (uint64_t)mul_i64(hi_i64(a), b) << (32U - n);
    return wrap_i64(high + (uint64_t)asr64((int64_t)lo_u64((uint64_t)a) * b, n));
}

int32_t add_scaled(int32_t x, int32_t a, int32_t b, unsigned n) {
    return sat_i32(x + asr64(mul_i64(a, b) + ((int64_t)1 << (n - 1U)), n));
}

int64_t within_i64(int64_t x, int64_t limit) {
    return x < -limit ? -limit : x > limit ? limit : x;
}
