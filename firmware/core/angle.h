/* The bodies of plumb/angle.h, inlined into the steps: the manual is there. atan2 and sincos take a constant
 * number of instructions. */
#ifndef PLUMB_CORE_ANGLE_H
#define PLUMB_CORE_ANGLE_H

#include "fixed.h"
#include "plumb/angle.h"

/* Coefficients of minimax polynomials, in turns; tools/fit_angle.py computes and checks them. */

/* clang-format off */
static const int32_t ANGLE_ATAN_Q33[8] = {
    1367129643, -455662709, 272695593, -190149124, 131821425, -76439450,
    29889517, -5543123};

static const int32_t ANGLE_ASIN_Q32[7] = {
    1073741824, -146689165, 60745628, -33710821, 19130782, -8341557,
    1831557};
/* clang-format on */

/* For angle_root_q29(): 1 / sqrt at the start of each segment (upper half) and its slope (lower half). */
extern const uint32_t plumb_angle_root[96];

/* One step of Horner's rule: c + p v, v in Q30 and at most 1. The product is floored to 4 units of c. */
KERNEL int32_t angle_horner(int32_t c, int32_t p, int32_t v_q30) {
    return c + 4 * mulhi_i32(p, v_q30);
}

/* sqrt(w / 2^30), Q29, for 2^30 <= w < 2^32: 1 / sqrt from a table by linear interpolation, then one Newton
 * step. */
KERNEL uint32_t angle_root_q29(uint32_t w) {
    const uint32_t entry = plumb_angle_root[(w >> 25) - 32U];
    const uint32_t r_q16 = (entry >> 16) - ((entry & 0xFFFFU) * (w >> 9 & 0xFFFFU) >> 16);
    const uint32_t s_q29 = (uint32_t)(mul_u64(w, r_q16) >> 17);
    const int32_t e_q30 = wrap_i32(mulhi_u32(w, r_q16 * r_q16) - (1U << 30));
    return s_q29 - (uint32_t)asr64(mul_i64((int32_t)s_q29, e_q30), 31);
}

KERNEL int32_t angle_atan2(int32_t y, int32_t x) {
    const uint32_t ax = abs_u32(x);
    const uint32_t ay = abs_u32(y);
    const uint32_t longer = max_u32(max_u32(ax, ay), 1U);
    const unsigned n = clz32(longer);
    const uint32_t denominator = longer << n >> 1;
    const uint32_t numerator = min_u32(ax, ay) << n & ~1U; /* twice, so that upper words are results */

    const uint32_t t_q31 = mulhi_u32(numerator, reciprocal_q61(denominator)) << 1;
    const int32_t square = (int32_t)mulhi_u32(t_q31, t_q31); /* Q30 */
    int32_t p = ANGLE_ATAN_Q33[7];
    p = angle_horner(ANGLE_ATAN_Q33[6], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[5], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[4], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[3], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[2], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[1], p, square);
    p = angle_horner(ANGLE_ATAN_Q33[0], p, square);
    uint32_t turn = mulhi_u32(t_q31, (uint32_t)p);

    turn = ay > ax ? PLUMB_ANGLE_QUARTER_TURN - turn : turn;
    turn = x < 0 ? PLUMB_ANGLE_HALF_TURN - turn : turn;
    return wrap_i32(y < 0 ? 0U - turn : turn);
}

KERNEL int32_t angle_asin(int32_t x_q30) {
    const uint32_t x = min_u32(abs_u32(x_q30), 1U << 30);
    const uint32_t rest = (1U << 30) - x; /* 1 - |x| */
    const unsigned m = clz32(max_u32(rest, 1U)) & ~1U;
    const uint32_t root = angle_root_q29(max_u32(rest, 1U) << m);

    const int32_t sine = any_i32((int32_t)x);
    int32_t p = ANGLE_ASIN_Q32[6];
    p = angle_horner(ANGLE_ASIN_Q32[5], p, sine);
    p = angle_horner(ANGLE_ASIN_Q32[4], p, sine);
    p = angle_horner(ANGLE_ASIN_Q32[3], p, sine);
    p = angle_horner(ANGLE_ASIN_Q32[2], p, sine);
    p = angle_horner(ANGLE_ASIN_Q32[1], p, sine);
    p = angle_horner(ANGLE_ASIN_Q32[0], p, sine);
    const uint32_t acos_turn = (uint32_t)(mul_u64(root, (uint32_t)p) >> 29) >> (m >> 1);
    const uint32_t turn = PLUMB_ANGLE_QUARTER_TURN - (rest == 0U ? 0U : acos_turn);
    return wrap_i32(x_q30 < 0 ? 0U - turn : turn);
}

#endif
