/* The body of plumb/kalman.h, inlined into the steps: the manual is there, with the equations (1) to (5). */
#ifndef PLUMB_CORE_KALMAN_H
#define PLUMB_CORE_KALMAN_H

#include "fixed.h"
#include "plumb/kalman.h"

KERNEL void kalman_step(plumb_kalman_t *restrict k, const plumb_kalman_params_t *restrict p, uint32_t r,
                        int32_t tilt_turn_q32, int32_t rate_turnps_q28) {
    /* (2) P = A P A^T + Q; the Q of p11 is added in (5) */
    const uint64_t p11 = (uint64_t)k->p11;
    const uint64_t p01_last = (uint64_t)k->p01;
    const uint64_t p01 = p01_last - p11;
    const uint64_t p00 = (uint64_t)k->p00 + make_u64(p->qa_hi, p->qa_lo) - (p01_last + p01);

    /* (4) K = P H^T / S, S = p00 + R: the upper 31 bits of each, aligned to the leading bit of S. The last
     * bit is set to 1 in place of the bits cut off: that is right on average, while the error of rounding
     * down would add up over the steps. */
    const unsigned n = clz32(hi_u64(p00) + r);
    const uint32_t p00a = hi_u64(p00) << (n - 1U) | lo_u64(p00) >> (33U - n) | 1U;
    const int32_t p01a = wrap_i32(hi_u64(p01) << (n - 1U) | lo_u64(p01) >> (33U - n) | 1U);
    const uint32_t y = reciprocal_q61(p00a + (r << (n - 1U)));
    const uint64_t k0_q61 = mul_u64(p00a, y);
    const uint32_t k0_q32 = hi_u64(k0_q61) << 3 | lo_u64(k0_q61) >> 29 | 1U;
    const int32_t k0_q29 = wrap_i32(hi_u64(k0_q61));
    const uint64_t k1_q61 = (uint64_t)mul_i64(p01a, wrap_i32(y));
    const int32_t k1_q29 = wrap_i32(hi_u64(k1_q61) + (lo_u64(k1_q61) >> 31));

    /* (5) p00 = R k0, which is exact enough for k0 near 1, too; p11 -= k1 p01, with the bits below 1 lsb in
     * p11_frac */
    k->p00 = wrap_i64(mul_u64(r, k0_q32));
    const uint64_t d = (uint64_t)mul_i64(k1_q29, p01a);
    const int32_t frac = wrap_i32(k->p11_frac_q30 + p->qb_frac_q30 - (lo_u64(d) << (36U - n) >> 2));
    const uint64_t fall = make_u64(hi_u64(d) >> (n - 4U), hi_u64(d) << (36U - n) | lo_u64(d) >> (n - 4U));
    const uint64_t p11_next = p11 - fall + p->qb + (uint64_t)(int64_t)asr32(frac, 30);
    k->p11 = make_i64(clamp_i32(wrap_i32(hi_u64(p11_next)), 0, (1 << 24) - 1), lo_u64(p11_next));
    k->p11_frac_q30 = (uint32_t)frac & 0x3FFFFFFFU;

    /* p01 *= 1 - k0: 64 bits by 32, the sign of p01 taken out of the unsigned product */
    const uint32_t c_q32 = ~k0_q32;
    const uint32_t p01_sign = (uint32_t)asr32(wrap_i32(hi_u64(p01)), 31);
    k->p01 =
        wrap_i64(mul_u64(hi_u64(p01), c_q32) + mulhi_u32(lo_u64(p01), c_q32) - make_u64(c_q32 & p01_sign, 0));

    /* (1), (3) */
    const int64_t bias = k->bias_turn_q61;
    const int64_t tilt =
        add64_wrap(sub64_wrap(k->tilt_turn_q61, bias), mul_i64(rate_turnps_q28, p->dt_s_q33));
    const int32_t innovation = sub_wrap(tilt_turn_q32, wrap_i32(shl_hi((uint64_t)tilt, 3)));
    k->tilt_turn_q61 = add64_wrap(tilt, mul_i64(k0_q29, innovation));
    const int64_t bias_next = add64_wrap(bias, mul_i64(k1_q29, innovation));
    k->bias_turn_q61 =
        make_i64(clamp_i32(hi_i64(bias_next), -(1 << 26), (1 << 26) - 1), lo_u64((uint64_t)bias_next));
    k->innovation_turn_q32 = innovation;
    k->k0_q29 = k0_q29;
    k->k1_q29 = k1_q29;
}

KERNEL int32_t kalman_tilt(const plumb_kalman_t *k) {
    return wrap_i32(shl_hi((uint64_t)k->tilt_turn_q61, 3));
}

KERNEL int32_t kalman_predicted(const plumb_kalman_t *k, const plumb_kalman_params_t *p,
                                int32_t rate_turnps_q28) {
    const int64_t tilt =
        add64_wrap(sub64_wrap(k->tilt_turn_q61, k->bias_turn_q61), mul_i64(rate_turnps_q28, p->dt_s_q33));
    return wrap_i32(shl_hi((uint64_t)tilt, 3));
}

KERNEL int32_t kalman_bias(const plumb_kalman_t *k, const plumb_kalman_params_t *p) {
    int32_t limit = p->bias_max_turn_q29, gain = p->rate_gain;
    uint32_t shift = p->rate_shift;
    LOADED3(limit, gain, shift);
    const int32_t hi = clamp_i32(hi_i64(k->bias_turn_q61), -limit, limit);
    const uint64_t bias = make_u64((uint32_t)hi, lo_u64((uint64_t)k->bias_turn_q61));
    return mulhi_i32(wrap_i32(shl_hi(bias, shift)), gain);
}

#endif
