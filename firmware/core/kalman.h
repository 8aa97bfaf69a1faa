/* The two-state filter: tilt and gyro bias, full covariance at every step, measurement variance given at
 * every step. The equations are numbered as the sources print them; P = [[p00, p01], [p01, p11]], K = [k0,
 * k1].
 *
 *     phi' = phi + dt (omega - b),  b' = b,  z = phi + noise of variance R
 *     (1) X = A X + B U
 *     (2) P = A P A^T + Q
 *     (3) X = X + K (z - phi)
 *     (4) K = P H^T / (p00 + R)
 *     (5) P = (I - K H) P
 *
 * Inside, the bias is counted per step (turn, not turn/s): A = [[1, -1], [0, 1]], and the covariance needs no
 * product with dt. Covariances are in lsb, a unit of the parameter set's own (about 2^-56 of the largest
 * variance in it): p00, p01, p11 as 64-bit integers, p11 and its process noise with 30 more bits of fraction;
 * r in 2^32 lsb. Why every sum fits: DESIGN.md, "Numbers".
 */
#ifndef PLUMB_CORE_KALMAN_H
#define PLUMB_CORE_KALMAN_H

#include "fixed.h"
#include <stdbool.h>

#define KALMAN_R_MAX 0x1000000UL /* 2^24 */

typedef struct {
    int32_t dt_s_q33;          /* period, up to 0.1 s */
    uint32_t rate_now;         /* U(k): 0 the previous gyro sample, as the sources print; 1 the current one */
    uint32_t qa_hi, qa_lo;     /* Q of the tilt per step, lsb; 0..2^56 */
    uint32_t qb;               /* Q of the bias per step, whole lsb; 0..2^32-1 */
    uint32_t qb_frac_q30;      /* and the rest of it; 0..2^30-1 */
    int32_t bias_max_turn_q29; /* limit of the published bias, per step; at most 1 turn/s */
    int32_t rate_gain;         /* 2^(31 - rate_shift) / dt, at least 2^30: turn per step -> turn/s */
    uint32_t rate_shift;       /* 1..16 */
} kalman_params_t;

/* X0 and P0. The bias and both its covariances are per step. */
typedef struct {
    int32_t bias_hi; /* turn Q61 */
    uint32_t bias_lo;
    int32_t tilt_turn_q32;
    uint32_t p00_hi, p00_lo; /* lsb, 0..2^57 */
    int32_t p01_hi;
    uint32_t p01_lo;         /* from -min(p00, 2^56) to min(p00, qa / 4) */
    uint32_t p11_hi, p11_lo; /* 0..2^56-1 */
} kalman_start_t;

typedef struct {
    int64_t tilt_turn_q61; /* modulo 8 turns; the angle is its bits 29..60 */
    int64_t bias_turn_q61; /* per step; +-1/8 turn */
    int64_t p00, p01, p11; /* posterior, lsb */
    uint32_t p11_frac_q30;
    int32_t innovation_turn_q32;
    int32_t k0_q29; /* gains of this step */
    int32_t k1_q29; /* turn per step, per turn */
} kalman_t;

void kalman_init(kalman_t *k, const kalman_start_t *s);

/* Predict with the gyro rate (turn/s, any int32), then correct with the measured tilt (any int32, wraps) of
 * variance r (1..KALMAN_R_MAX). Constant number of instructions, one UDIV, no branch. */
void kalman_step(kalman_t *k, const kalman_params_t *p, uint32_t r, int32_t tilt_turn_q32,
                 int32_t rate_turnps_q28);

/* Fused tilt, turn Q32. */
static inline int32_t kalman_tilt(const kalman_t *k) {
    return wrap_i32(shl_hi((uint64_t)k->tilt_turn_q61, 3));
}

/* What the next step expects to be measured, turn Q32: (1) with that rate. Given back as the measurement, the
 * innovation is 0 and nothing is corrected. */
static inline int32_t kalman_predicted(const kalman_t *k, const kalman_params_t *p, int32_t rate_turnps_q28) {
    const int64_t tilt =
        add64_wrap(sub64_wrap(k->tilt_turn_q61, k->bias_turn_q61), mul_i64(rate_turnps_q28, p->dt_s_q33));
    return wrap_i32(shl_hi((uint64_t)tilt, 3));
}

/* Bias, turn/s Q28, within the limit bias_max. */
static inline int32_t kalman_bias(const kalman_t *k, const kalman_params_t *p) {
    const int32_t hi = clamp_i32(hi_i64(k->bias_turn_q61), -p->bias_max_turn_q29, p->bias_max_turn_q29);
    const uint64_t bias = make_u64((uint32_t)hi, lo_u64((uint64_t)k->bias_turn_q61));
    return mulhi_i32(wrap_i32(shl_hi(bias, p->rate_shift)), p->rate_gain);
}

/* The ranges above, and that the published bias stays below 1 turn/s. */
bool kalman_valid(const kalman_params_t *p, const kalman_start_t *s);

#endif
