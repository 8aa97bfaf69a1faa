/* The kernels of the core and their alternatives, for tools/gen_choices.py: what each costs, and how far off
 * it is. The image has none of the alternatives. atan2_N: N terms of the polynomial, in 32-bit words;
 * coefficients: written by the tool. cordic_N: N turns. */
#include <stdbool.h>

#include "core/angle.h"
#include "terms.h"

static int32_t from_octant(uint32_t turn, int32_t y, int32_t x) {
    turn = abs_u32(y) > abs_u32(x) ? PLUMB_ANGLE_QUARTER_TURN - turn : turn;
    turn = x < 0 ? PLUMB_ANGLE_HALF_TURN - turn : turn;
    return wrap_i32(y < 0 ? 0U - turn : turn);
}

/* Quotient of the shorter by the longer, Q31. */
static inline uint32_t quotient_q31(int32_t y, int32_t x) {
    const uint32_t ax = abs_u32(x), ay = abs_u32(y), longer = max_u32(max_u32(ax, ay), 1U);
    const unsigned n = clz32(longer);
    return mulhi_u32(min_u32(ax, ay) << n & ~1U, reciprocal_q61(longer << n >> 1)) << 1;
}

#define ATAN2(terms)                                                                                         \
    int32_t atan2_##terms(int32_t y, int32_t x) {                                                            \
        const uint32_t t_q31 = quotient_q31(y, x);                                                           \
        const int32_t square = (int32_t)mulhi_u32(t_q31, t_q31);                                             \
        int32_t p = ATAN_Q33_##terms[(terms) - 1];                                                           \
        _Pragma("GCC unroll 16") for (int i = (terms) - 2; i >= 0; i--) p =                                  \
            angle_horner(ATAN_Q33_##terms[i], p, square);                                                    \
        return from_octant(mulhi_u32(t_q31, (uint32_t)p), y, x);                                             \
    }

ATAN2(2)
ATAN2(3)
ATAN2(4)
ATAN2(5)
ATAN2(6)

int32_t atan2_shipped(int32_t y, int32_t x) {
    return angle_atan2(y, x);
}

/* Words of 16 bits: one division, products of 32 bits. */
int32_t atan2_short(int32_t y, int32_t x) {
    const uint32_t ax = abs_u32(x), ay = abs_u32(y), longer = max_u32(max_u32(ax, ay), 1U);
    const unsigned n = clz32(longer);
    const int32_t t_q15 = (int32_t)udiv32(min_u32(ax, ay) << n >> 1, longer << n >> 16);
    const int32_t square = t_q15 * t_q15 >> 15;
    int32_t p = ATAN_Q17_5[4];
    _Pragma("GCC unroll 16") for (int i = 3; i >= 0; i--) p = ATAN_Q17_5[i] + (p * square >> 15);
    return from_octant((uint32_t)(t_q15 * p), y, x);
}

static inline int32_t cordic(int32_t y, int32_t x, int turns) {
    const uint32_t longer = max_u32(max_u32(abs_u32(y), abs_u32(x)), 1U);
    const unsigned n = clz32(longer);
    int32_t a = (int32_t)(abs_u32(x) << n >> 3), b = (int32_t)(abs_u32(y) << n >> 3);
    uint32_t turn = 0;
    for (int i = 0; i < turns; i++) {
        const int32_t was = a;
        const bool up = b >= 0;
        a = up ? a + asr32(b, (unsigned)i) : a - asr32(b, (unsigned)i);
        b = up ? b - asr32(was, (unsigned)i) : b + asr32(was, (unsigned)i);
        turn = up ? turn + CORDIC_Q32[i] : turn - CORDIC_Q32[i];
    }
    turn = x < 0 ? PLUMB_ANGLE_HALF_TURN - turn : turn;
    return wrap_i32(y < 0 ? 0U - turn : turn);
}

int32_t cordic_8(int32_t y, int32_t x) {
    return cordic(y, x, 8);
}
int32_t cordic_16(int32_t y, int32_t x) {
    return cordic(y, x, 16);
}
int32_t cordic_24(int32_t y, int32_t x) {
    return cordic(y, x, 24);
}

/* 2^61 / d for 2^30 <= d < 2^31. */
uint32_t reciprocal_shipped(uint32_t d) {
    return reciprocal_q61(d);
}

uint32_t reciprocal_division(uint32_t d) {
    return udiv32(0xFFFFFFFFU, d >> 15) << 14;
}

/* Without a division: a line, then Newton steps. x: 2^61 / d, Q31 of 2^30 / d. */
static inline uint32_t newton(uint32_t d, int steps) {
    uint32_t x = 3129381000U - d; /* 2.914 - 2 d, of d in Q32, halved: within 9 % */
    for (int i = 0; i < steps; i++) {
        const uint32_t product = mulhi_u32(d << 1, x); /* 1 is 2^31 / 2 */
        x = mulhi_u32(x, 0x80000000U - product) << 2;
    }
    return x;
}

uint32_t reciprocal_newton_2(uint32_t d) {
    return newton(d, 2);
}
uint32_t reciprocal_newton_3(uint32_t d) {
    return newton(d, 3);
}
uint32_t reciprocal_newton_4(uint32_t d) {
    return newton(d, 4);
}

uint32_t reciprocal_library(uint32_t d) {
    const uint64_t found = (1ULL << 61) / d;
    return found > 0x7FFFFFFFU ? 0x7FFFFFFFU : (uint32_t)found;
}
