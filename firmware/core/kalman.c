#include "kalman.h"

#define COVARIANCE_MAX ((int64_t)1 << 56)

void kalman_init(kalman_t *k, const kalman_start_t *s) {
    *k = (kalman_t){
        .tilt_turn_q61 = make_i64(asr32(s->tilt_turn_q32, 3), (uint32_t)s->tilt_turn_q32 << 29),
        .bias_turn_q61 = make_i64(s->bias_hi, s->bias_lo),
        .p00 = wrap_i64(make_u64(s->p00_hi, s->p00_lo)),
        .p01 = make_i64(s->p01_hi, s->p01_lo),
        .p11 = wrap_i64(make_u64(s->p11_hi, s->p11_lo)),
    };
}

void kalman_step(kalman_t *restrict k, const kalman_params_t *restrict p, uint32_t r, int32_t tilt_turn_q32,
                 int32_t rate_turnps_q28) {
    /* (2) P = A P A^T + Q, but p11, which waits for (5) */
    const uint64_t p11 = (uint64_t)k->p11;
    const uint64_t p01_last = (uint64_t)k->p01;
    const uint64_t p01 = p01_last - p11;
    const uint64_t p00 = (uint64_t)k->p00 + make_u64(p->qa_hi, p->qa_lo) - (p01_last + p01);

    /* (4) K = P H^T / S, S = p00 + R: 31 bits of each from the first bit of S. A last bit of 1 stands for
     * what was cut off: it is right on average, where a floor would add up over the steps. */
    const unsigned n = clz32(hi_u64(p00) + r);
    const uint32_t p00a = hi_u64(p00) << (n - 1U) | lo_u64(p00) >> (33U - n) | 1U;
    const int32_t p01a = wrap_i32(hi_u64(p01) << (n - 1U) | lo_u64(p01) >> (33U - n) | 1U);
    const uint32_t y = reciprocal_q61(p00a + (r << (n - 1U)));
    const uint64_t k0_q61 = mul_u64(p00a, y);
    const uint32_t k0_q32 = hi_u64(k0_q61) << 3 | lo_u64(k0_q61) >> 29 | 1U;
    const int32_t k0_q29 = wrap_i32(hi_u64(k0_q61));
    const uint64_t k1_q61 = (uint64_t)mul_i64(p01a, wrap_i32(y));
    const int32_t k1_q29 = wrap_i32(hi_u64(k1_q61) + (lo_u64(k1_q61) >> 31));

    /* (5) p00 = R k0, good where k0 is near 1, too; p11 -= k1 p01, whose bits below 1 lsb go into p11_frac */
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

bool kalman_valid(const kalman_params_t *p, const kalman_start_t *s) {
    const int64_t qa = wrap_i64(make_u64(p->qa_hi, p->qa_lo));
    const int64_t p00 = wrap_i64(make_u64(s->p00_hi, s->p00_lo));
    const int64_t p01 = make_i64(s->p01_hi, s->p01_lo);
    const int64_t p11 = wrap_i64(make_u64(s->p11_hi, s->p11_lo));
    if (p->rate_shift < 1U || p->rate_shift > 16U || p->bias_max_turn_q29 < 0)
        return false;
    /* the published bias: its upper word after the shift within 2^30, and 1 turn/s */
    const uint64_t bias = (uint64_t)((uint32_t)p->bias_max_turn_q29 + 1U) << p->rate_shift;
    return p->dt_s_q33 >= 1 && p->rate_now <= 1U && p->rate_gain >= 1 << 30 && bias <= 1U << 30 &&
           bias * (uint32_t)p->rate_gain < (uint64_t)1 << 60 && qa >= 0 && qa <= COVARIANCE_MAX &&
           p->qb_frac_q30 < 1U << 30 && s->bias_hi > -(1 << 26) && s->bias_hi < 1 << 26 && p00 >= 0 &&
           p00 <= 2 * COVARIANCE_MAX && p11 >= 0 && p11 < COVARIANCE_MAX && p01 <= p00 && p01 >= -p00 &&
           p01 >= -COVARIANCE_MAX && p01 <= qa / 4;
}
