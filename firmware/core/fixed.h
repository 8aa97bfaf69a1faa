/* Integer arithmetic of the core: the only file that shifts signed numbers right.
 *
 * Functions named wrap and ..._wrap compute modulo 2^32 or 2^64: no operation here is undefined for an input
 * within its stated range. Costs are Cortex-M3 cycles at zero wait states. udiv32 is the only division; no
 * 64-bit value is ever divided.
 */
#ifndef PLUMB_CORE_FIXED_H
#define PLUMB_CORE_FIXED_H

#include <stdint.h>

/* Always inlined, whatever its size: the step makes no call, and values stay in registers from one kernel to
 * the next. */
#if defined(__GNUC__)
#define KERNEL static inline __attribute__((always_inline))
#else
#define KERNEL static inline
#endif

/* Called when parameters change or a run begins: small rather than fast. */
#if defined(__GNUC__)
#define SELDOM_CALLED __attribute__((cold))
#else
#define SELDOM_CALLED
#endif

/* Right shifts of signed numbers must be arithmetic, as gcc and clang make them. */
typedef char fixed_assert_arithmetic_shift[((-5) >> 1) == -3 ? 1 : -1];

/* The same bits as a signed number: arithmetic modulo 2^32 and 2^64, without undefined behaviour. */
static inline int32_t wrap_i32(uint32_t x) {
    return (int32_t)x;
}

static inline int64_t wrap_i64(uint64_t x) {
    return (int64_t)x;
}

static inline int32_t add_wrap(int32_t a, int32_t b) {
    return wrap_i32((uint32_t)a + (uint32_t)b);
}

static inline int32_t sub_wrap(int32_t a, int32_t b) {
    return wrap_i32((uint32_t)a - (uint32_t)b);
}

/* floor((a + b) / 2) of any two numbers. */
static inline int32_t mean_floor(int32_t a, int32_t b) {
    return (a & b) + ((a ^ b) >> 1);
}

static inline int64_t add64_wrap(int64_t a, int64_t b) {
    return wrap_i64((uint64_t)a + (uint64_t)b);
}

static inline int64_t sub64_wrap(int64_t a, int64_t b) {
    return wrap_i64((uint64_t)a - (uint64_t)b);
}

/* Arithmetic shifts right: floor(x / 2^n). 0 <= n <= 31, 63. */
static inline int32_t asr32(int32_t x, unsigned n) {
    return x >> n;
}

static inline int64_t asr64(int64_t x, unsigned n) {
    return x >> n;
}

/* The low n bits of x as a signed number; 1 <= n <= 32. */
static inline int32_t sign_extend(int32_t x, unsigned n) {
    return asr32(wrap_i32((uint32_t)x << (32U - n)), 32U - n);
}

static inline uint32_t hi_u64(uint64_t x) {
    return (uint32_t)(x >> 32);
}

static inline uint32_t lo_u64(uint64_t x) {
    return (uint32_t)x;
}

static inline int32_t hi_i64(int64_t x) {
    return (int32_t)(x >> 32);
}

static inline uint64_t make_u64(uint32_t hi, uint32_t lo) {
    return ((uint64_t)hi << 32) | lo;
}

static inline int64_t make_i64(int32_t hi, uint32_t lo) {
    return wrap_i64(make_u64((uint32_t)hi, lo));
}

/* Exact products (5 cycles at most); mulhi_*: the upper word of the product. */
static inline int64_t mul_i64(int32_t a, int32_t b) {
    return (int64_t)a * b;
}

static inline uint64_t mul_u64(uint32_t a, uint32_t b) {
    return (uint64_t)a * b;
}

static inline uint32_t mulhi_u32(uint32_t a, uint32_t b) {
    return hi_u64(mul_u64(a, b));
}

static inline int32_t mulhi_i32(int32_t a, int32_t b) {
    return hi_i64(mul_i64(a, b));
}

/* a * b / 2^32, rounded to nearest. */
static inline int32_t mulhi_near(int32_t a, int32_t b) {
    const int64_t product = mul_i64(a, b);
    return hi_i64(product) + (int32_t)(lo_u64((uint64_t)product) >> 31);
}

/* x, with its range hidden from the compiler: gcc multiplies a factor that it knows to be non-negative as
 * unsigned, and then corrects the sign of the product. */
static inline int32_t any_i32(int32_t x) {
#if defined(__GNUC__)
    __asm__("" : "+r"(x));
#endif
    return x;
}

/* Load these values now, one after the other: on the Cortex-M3 each load that follows a load takes one cycle
 * instead of two. */
#if defined(__GNUC__) && defined(__arm__)
#define LOADED2(a, b)       __asm__("" : "+r"(a), "+r"(b))
#define LOADED3(a, b, c)    __asm__("" : "+r"(a), "+r"(b), "+r"(c))
#define LOADED4(a, b, c, d) __asm__("" : "+r"(a), "+r"(b), "+r"(c), "+r"(d))
#else
#define LOADED2(a, b)       (void)0
#define LOADED3(a, b, c)    (void)0
#define LOADED4(a, b, c, d) (void)0
#endif

static inline int32_t min_i32(int32_t a, int32_t b) {
    return a < b ? a : b;
}

static inline int32_t max_i32(int32_t a, int32_t b) {
    return a > b ? a : b;
}

static inline int32_t clamp_i32(int32_t x, int32_t low, int32_t high) {
    return min_i32(max_i32(x, low), high);
}

/* x clamped to n bits, -2^(n-1)..2^(n-1)-1; 1 <= n <= 31, a constant. Assembly, because gcc does not use SSAT
 * where it has put the two bounds into registers. */
#if defined(__GNUC__) && defined(__thumb2__)
#define SATURATE(x, n)                                                                                       \
    __extension__({                                                                                          \
        int32_t saturated;                                                                                   \
        __asm__("ssat %0, %1, %2" : "=r"(saturated) : "I"(n), "r"(x));                                       \
        saturated;                                                                                           \
    })
#else
#define SATURATE(x, n) clamp_i32(x, -(1 << ((n) - 1)), (1 << ((n) - 1)) - 1)
#endif

static inline uint32_t min_u32(uint32_t a, uint32_t b) {
    return a < b ? a : b;
}

static inline uint32_t max_u32(uint32_t a, uint32_t b) {
    return a > b ? a : b;
}

/* |x|, with |INT32_MIN| = 2^31. */
static inline uint32_t abs_u32(int32_t x) {
    return x < 0 ? 0U - (uint32_t)x : (uint32_t)x;
}

/* Number of leading zero bits; x > 0. One instruction on the target. */
static inline unsigned clz32(uint32_t x) {
#if defined(__GNUC__)
    return (unsigned)__builtin_clz(x);
#else
    unsigned n = 0;
    for (; !(x & 0x80000000U); x <<= 1) {
        n++;
    }
    return n;
#endif
}

/* a / b by UDIV, 2 to 12 cycles. b > 0. */
static inline uint32_t udiv32(uint32_t a, uint32_t b) {
    return a / b;
}

/* 2^61 / d for 2^30 <= d < 2^31: too low by at most 2^-28 of the value, too high by at most 3, and at most
 * 2^31 - 1. The division gives 16 bits of the quotient, one Newton step doubles them. e = x * (d / 2) - 2^46,
 * which fits 32 bits. 21 cycles. */
static inline uint32_t reciprocal_q61(uint32_t d) {
    const uint32_t x = udiv32(0xFFFFFFFFU, d >> 15);
    const int32_t e = wrap_i32(x * (d >> 1));
    return (x << 14) - (uint32_t)asr32((int32_t)x * (asr32(e, 17) + 1), 15);
}

/* Upper word of x * 2^n, 1 <= n <= 31. */
static inline uint32_t shl_hi(uint64_t x, unsigned n) {
    return (hi_u64(x) << n) | (lo_u64(x) >> (32U - n));
}

/* Upper word of a signed x times 2^n, 1 <= n <= 31, saturated to 32 bits. */
static inline int32_t sat_shl_hi(int64_t x, unsigned n) {
    const int32_t limit = (int32_t)(0x80000000U >> n);
    const int32_t hi = clamp_i32(hi_i64(x), -limit, limit - 1);
    return wrap_i32(shl_hi(make_u64((uint32_t)hi, lo_u64((uint64_t)x)), n));
}

/* x saturated to 32 bits. */
static inline int32_t sat_i32(int64_t x) {
    return x < INT32_MIN ? INT32_MIN : x > INT32_MAX ? INT32_MAX : (int32_t)x;
}

/* floor(a * b / 2^n), 0 < n <= 32; the result must fit 64 bits. */
KERNEL int64_t mul_shift(int64_t a, int32_t b, unsigned n) {
    const uint64_t high = (uint64_t)mul_i64(hi_i64(a), b) << (32U - n);
    return wrap_i64(high + (uint64_t)asr64((int64_t)lo_u64((uint64_t)a) * b, n));
}

/* Part of add_scaled() for sums that may not fit 32 bits; not inlined. product: rounding included. */
int32_t plumb_add_scaled_far(int32_t x, int64_t product, unsigned n);

/* x + a * b / 2^n, rounded to nearest (halves up) and saturated to int32; 0 < n < 63, a constant. Words of 32
 * bits while the sum fits, which it nearly always does. */
KERNEL int32_t add_scaled(int32_t x, int32_t a, int32_t b, unsigned n) {
    const int64_t product = mul_i64(a, b) + ((int64_t)1 << (n - 1U));
#if defined(__GNUC__)
    if (n <= 32U) {
        const int32_t hi = hi_i64(product);
        const uint32_t below = n == 32U ? 0U : lo_u64((uint64_t)product) >> (n & 31U);
        const int32_t part = wrap_i32(n == 32U ? (uint32_t)hi : (uint32_t)hi << (32U - n) | below);
        int32_t sum;
        if (__builtin_expect(asr32(hi, n - 1U) == asr32(hi, 31), 1) &&
            !__builtin_add_overflow(x, part, &sum)) {
            return sum;
        }
    }
#endif
    return plumb_add_scaled_far(x, product, n);
}

/* x clamped to +-limit. */
KERNEL int64_t within_i64(int64_t x, int64_t limit) {
    return x < -limit ? -limit : x > limit ? limit : x;
}

#endif
