#include "kalman.h"

void kalman_step(kalman_t *k, const kalman_params_t *p, int32_t rate_turnps_q28, int32_t z_turn_q32, uint32_t r) {
    /* (2) P = A P A^T + Q */
    const int64_t p01 = sub64_wrap(k->p01, k->p11);
    const uint64_t p00 = (uint64_t)k->p00 - (uint64_t)k->p01 - (uint64_t)p01 + make_u64(p->qa_hi, p->qa_lo);
    uint32_t p11_frac = k->p11_frac + p->qb_frac;
    uint64_t p11 = (uint64_t)k->p11 + p->qb + (p11_frac < p->qb_frac);

    /* (4) K = P H^T / S; 1/S from a division of 16 bits and one Newton step */
    const uint64_t s = p00 + make_u64(r, 0);
    const unsigned a = clz32(hi_u64(s)) - 1U;
    const uint32_t sa = shl_hi(s, a);
    const uint32_t x = udiv32(0xFFFFFFFFU, sa >> 15);
    const int32_t e = wrap_i32(0U - x * (sa >> 1));
    const uint32_t y = (x << 14) + (uint32_t)asr32((int32_t)x * asr32(e, 17), 15);
    const uint64_t g0 = mul_u64(shl_hi(p00, a), y);
    const int32_t p01a = (int32_t)shl_hi((uint64_t)p01, a);
    const int64_t g1 = mul_i64(p01a, (int32_t)y);
    const uint32_t k0_q32 = (uint32_t)(g0 >> 29);
    const int32_t k1_q30 = (int32_t)(uint32_t)((uint64_t)g1 >> 31);

    /* (5) */
#ifdef SELECT
    const uint32_t c_q32 = 0U - k0_q32;
    uint64_t m = p00;
    uint32_t f = c_q32;
    if (k0_q32 >= 0x80000000U) {
        m = make_u64(r, 0);
        f = k0_q32;
    }
    const uint64_t p00_next = mul_u64(hi_u64(m), f) + mulhi_u32(lo_u64(m), f);
#else
    const uint32_t c_q32 = 0U - k0_q32;
    const uint64_t p00_next = mul_u64(r, k0_q32);
#endif
    k->p00 = (int64_t)p00_next;
    const uint32_t p01_lo = lo_u64((uint64_t)p01);
    const int32_t p01_hi = hi_i64(p01);
    const uint64_t p01n = mul_u64((uint32_t)p01_hi, c_q32) - make_u64(c_q32 & (uint32_t)asr32(p01_hi, 31), 0) +
                          mulhi_u32(p01_lo, c_q32);
    k->p01 = (int64_t)make_u64((uint32_t)min_i32((int32_t)hi_u64(p01n), (int32_t)(hi_u64(p00_next) >> 1) - 1), lo_u64(p01n));
    const int64_t d = mul_i64(k1_q30, p01a);
    const uint32_t df = (uint32_t)d << (34U - a);
    p11 -= (uint64_t)(lo_u64((uint64_t)d) >> (a - 2U) | hi_u64((uint64_t)d) << (34U - a)) + make_u64(hi_u64((uint64_t)d) >> (a - 2U), 0);
    p11 -= p11_frac < df;
    p11_frac -= df;
    if ((int32_t)hi_u64(p11) < 0) p11 = 0;
    if ((int32_t)hi_u64(p11) > (1 << 25)) p11 = (uint64_t)1 << 57;
    k->p11 = (int64_t)p11;
    k->p11_frac = p11_frac;

    /* (1), (3) */
    int64_t tilt = add64_wrap(sub64_wrap(k->tilt_turn_q62, k->bias_turn_q62), mul_i64(rate_turnps_q28, p->dt_s_q34));
    const int32_t innov = wrap_i32((uint32_t)z_turn_q32 - (uint32_t)((uint64_t)tilt >> 30));
    tilt = add64_wrap(tilt, mul_i64((int32_t)(k0_q32 >> 2), innov));
    int64_t bias = add64_wrap(k->bias_turn_q62, mul_i64(k1_q30, innov));
    const int32_t bm = p->bias_max_turn_q30;
    bias = make_i64(clamp_i32(hi_i64(bias), -bm, bm), lo_u64((uint64_t)bias));
    k->tilt_turn_q62 = tilt;
    k->bias_turn_q62 = bias;
    k->innovation_turn_q32 = innov;
    k->k0_q30 = k0_q32 >> 2;
    k->k1_q30 = k1_q30;
}
