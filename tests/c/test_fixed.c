/* Arithmetic: wrapping, shifting, saturating, and the reciprocal against its stated error. */
#include "check.h"
#include "core/fixed.h"

static void wraps(void) {
    CHECK(add_wrap(INT32_MAX, 1) == INT32_MIN);
    CHECK(sub_wrap(INT32_MIN, 1) == INT32_MAX);
    CHECK(add64_wrap(INT64_MAX, 1) == INT64_MIN);
    CHECK(sub64_wrap(INT64_MIN, 1) == INT64_MAX);
    CHECK(wrap_i32(0x80000000U) == INT32_MIN);
    CHECK(wrap_i64(UINT64_MAX) == -1);
}

static void shifts(void) {
    CHECK(asr32(-5, 1) == -3 && asr32(5, 1) == 2 && asr32(INT32_MIN, 31) == -1);
    CHECK(asr64(-1, 63) == -1 && asr64(INT64_MIN, 62) == -2);
    CHECK(shl_hi(0x0000000180000000U, 1) == 3U);
    CHECK(shl_hi(0x00000000FFFFFFFFU, 31) == 0x7FFFFFFFU);
    CHECK(hi_i64(-1) == -1 && hi_u64(0x123456789ABCDEF0U) == 0x12345678U &&
          lo_u64(0x123456789ABCDEF0U) == 0x9ABCDEF0U);
    CHECK(make_i64(-1, 0) == -4294967296LL && make_u64(1, 2) == 4294967298U);
}

static void limits(void) {
    CHECK(clamp_i32(5, -1, 3) == 3 && clamp_i32(-5, -1, 3) == -1 && clamp_i32(2, -1, 3) == 2);
    CHECK(min_u32(1, 2) == 1U && max_u32(1, 2) == 2U && min_i32(-1, 1) == -1 && max_i32(-1, 1) == 1);
    CHECK(abs_u32(INT32_MIN) == 0x80000000U && abs_u32(-7) == 7U && abs_u32(7) == 7U);
    CHECK(clz32(1) == 31U && clz32(UINT32_MAX) == 0U);
}

static void products(void) {
    CHECK(mul_i64(INT32_MIN, INT32_MIN) == 4611686018427387904LL);
    CHECK(mul_u64(UINT32_MAX, UINT32_MAX) == 18446744065119617025U);
    CHECK(mulhi_i32(INT32_MIN, INT32_MAX) == -1073741824);
    CHECK(mulhi_i32(-1, 1) == -1 && mulhi_u32(0x80000000U, 2) == 1U);
}

/* add_scaled against its definition in 64 bits: the sum that fits 32 bits, that which just does, and that
 * which does not. The shift is a constant, as everywhere. */
static int32_t added(int32_t x, int32_t a, int32_t b, unsigned n) {
    return sat_i32(x + asr64((int64_t)a * b + ((int64_t)1 << (n - 1U)), n));
}

static void check_add_scaled(void) {
    for (uint32_t i = 0; i < 1000000; i++) {
        const int32_t x = check_random_wild(), a = check_random_wild(), b = check_random_wild();
        CHECK(add_scaled(x, a, b, 1) == added(x, a, b, 1));
        CHECK(add_scaled(x, a, b, 16) == added(x, a, b, 16));
        CHECK(add_scaled(x, a, b, 28) == added(x, a, b, 28));
        CHECK(add_scaled(x, a, b, 31) == added(x, a, b, 31));
        CHECK(add_scaled(x, a, b, 32) == added(x, a, b, 32));
        CHECK(add_scaled(x, a, b, 36) == added(x, a, b, 36));
    }
    CHECK(add_scaled(0, INT32_MAX, 1 << 28, 28) == INT32_MAX);
    CHECK(add_scaled(1, INT32_MAX, 1 << 28, 28) == INT32_MAX);
    CHECK(add_scaled(-1, INT32_MIN, 1 << 28, 28) == INT32_MIN);
    CHECK(add_scaled(INT32_MIN, INT32_MIN, INT32_MIN, 31) == 0);
}

/* y d lies within [1 - 2^-28, 1 + 3 d / 2^61] of 2^61, and y is a positive int32. */
static void reciprocal_at(uint32_t d) {
    const uint32_t y = reciprocal_q61(d);
    const uint64_t product = mul_u64(y, d);
    const uint64_t one = (uint64_t)1 << 61;
    CHECK(y <= 0x7FFFFFFFU);
    CHECK(product <= one + 3U * (uint64_t)d);
    CHECK(product >= one - (one >> 28));
}

int main(void) {
    wraps();
    shifts();
    limits();
    products();
    check_add_scaled();
    for (uint32_t i = 0; i < 200000U; i++) {
        reciprocal_at(0x40000000U + i);
        reciprocal_at(0x7FFFFFFFU - i);
        reciprocal_at(0x40000000U + 5347U * i); /* every segment of the seed */
        reciprocal_at(0x40000000U | (check_random() >> 2));
    }
    return check_failures != 0;
}
