#include "kalman.h"

#define COVARIANCE_MAX ((int64_t)1 << 56)

SELDOM_CALLED void plumb_kalman_init(plumb_kalman_t *k, const plumb_kalman_start_t *s) {
    *k = (plumb_kalman_t){
        .tilt_turn_q61 = make_i64(asr32(s->tilt_turn_q32, 3), (uint32_t)s->tilt_turn_q32 << 29),
        .bias_turn_q61 = make_i64(s->bias_hi, s->bias_lo),
        .p00 = wrap_i64(make_u64(s->p00_hi, s->p00_lo)),
        .p01 = make_i64(s->p01_hi, s->p01_lo),
        .p11 = wrap_i64(make_u64(s->p11_hi, s->p11_lo)),
    };
}

SELDOM_CALLED bool plumb_kalman_valid(const plumb_kalman_params_t *p, const plumb_kalman_start_t *s) {
    const int64_t qa = wrap_i64(make_u64(p->qa_hi, p->qa_lo));
    const int64_t p00 = wrap_i64(make_u64(s->p00_hi, s->p00_lo));
    const int64_t p01 = make_i64(s->p01_hi, s->p01_lo);
    const int64_t p11 = wrap_i64(make_u64(s->p11_hi, s->p11_lo));
    if (p->rate_shift < 1U || p->rate_shift > 16U || p->bias_max_turn_q29 < 0) {
        return false;
    }
    /* the published bias: its upper word after the shift within 2^30, and 1 turn/s */
    const uint64_t bias = (uint64_t)((uint32_t)p->bias_max_turn_q29 + 1U) << p->rate_shift;
    return p->dt_s_q33 >= 1 && p->rate_now <= 2U && p->rate_gain >= 1 << 30 && bias <= 1U << 30 &&
           bias * (uint32_t)p->rate_gain < (uint64_t)1 << 60 && qa >= 0 && qa <= COVARIANCE_MAX &&
           p->qb_frac_q30 < 1U << 30 && s->bias_hi > -(1 << 26) && s->bias_hi < 1 << 26 && p00 >= 0 &&
           p00 <= 2 * COVARIANCE_MAX && p11 >= 0 && p11 < COVARIANCE_MAX && p01 <= p00 && p01 >= -p00 &&
           p01 >= -COVARIANCE_MAX && p01 <= qa / 4;
}
