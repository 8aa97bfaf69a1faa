/* The two-state filter: tilt and gyro bias, full covariance at every step, measurement variance given at
 * every step.
 *
 *     phi' = phi + dt (omega - b) ;  z = phi + noise              P = [[p00, p01], [p01, p11]],  K = [k0, k1]
 *     (1) X = A X + B U   (2) P = A P A^T + Q   (3) X += K (z - phi)   (4) K = P H^T / (p00 + R)   (5) P = (I
 * - K H) P
 *
 * Inside, the bias is counted per step (turn, not turn/s): A = [[1, -1], [0, 1]], and no product with dt is
 * needed in the covariance. Covariances are in lsb, a unit of the parameter set's own (about 2^-57 of the
 * largest variance it needs): p00, p01, p11 as 64-bit integers, p11 and its process noise with 32 more bits
 * of fraction; r in 2^32 lsb.
 *
 * Limits that make every sum below fit (kalman_valid): r <= 2^25, qa, p00, p11 <= 2^57, |p01| <= 2^56, qb <
 * 2^57.
 */
#ifndef PLUMB_CORE_KALMAN_H
#define PLUMB_CORE_KALMAN_H

#include "fixed.h"
#include <stdbool.h>

#define KALMAN_R_MAX (1UL << 25)

typedef struct {
    int32_t dt_s_q34;          /* period, 1 .. 0.1 s */
    uint32_t rate_now;         /* U(k): 0 the previous gyro sample, as the sources print; 1 the current one */
    uint32_t qa_hi, qa_lo;     /* Q of the tilt per step, lsb */
    uint32_t qb, qb_frac;      /* Q of the bias per step: whole lsb, and 2^-32 lsb */
    int32_t bias_max_turn_q30; /* |bias per step| is clamped here */
    int32_t
        rate_gain; /* 2^(30 - rate_shift) / dt, in [2^30, 2^31) unless dt > 0.5 s: turn per step -> turn/s */
    uint32_t rate_shift; /* 1..16 */
} kalman_params_t;

typedef struct {
    int32_t bias_hi; /* bias per step, turn Q62 */
    uint32_t bias_lo;
    int32_t tilt_turn_q32;
    uint32_t p00_hi, p00_lo; /* lsb */
    int32_t p01_hi;
    uint32_t p01_lo;
    uint32_t p11_hi, p11_lo;
} kalman_start_t;

typedef struct {
    int64_t tilt_turn_q62; /* modulo 4 turns; the angle is its bits 30..61 */
    int64_t bias_turn_q62; /* per step */
    int64_t p00, p01, p11; /* posterior, lsb */
    uint32_t p11_frac;     /* 2^-32 lsb */
    int32_t innovation_turn_q32;
    uint32_t k0_q30; /* gains of the last step */
    int32_t k1_q30;  /* bias per step, turn per turn */
} kalman_t;

void kalman_init(kalman_t *k, const kalman_start_t *s);

/* Predict with the gyro rate (turn/s Q28, any int32), then correct with the measured tilt z (turn Q32, wraps)
 * of variance r (1..KALMAN_R_MAX). Constant number of instructions, one UDIV. */
void kalman_step(kalman_t *k, const kalman_params_t *p, int32_t rate_turnps_q28, int32_t z_turn_q32,
                 uint32_t r);

/* Fused tilt, turn Q32. */
static inline int32_t kalman_tilt(const kalman_t *k) {
    return (int32_t)(uint32_t)((uint64_t)k->tilt_turn_q62 >> 30);
}

/* Bias in turn/s Q28, from turn per step Q62. */
static inline int32_t kalman_bias(const kalman_t *k, const kalman_params_t *p) {
    return mulhi_i32((int32_t)shl_hi((uint64_t)k->bias_turn_q62, p->rate_shift), p->rate_gain);
}

bool kalman_valid(const kalman_params_t *p, const kalman_start_t *s);

#endif
