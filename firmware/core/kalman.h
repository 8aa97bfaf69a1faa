/* Tilt and gyro bias from a rate and a measured tilt: the two-state Kalman filter, covariance updated at
 * every step.
 *
 *     phi' = omega - b + w_g,  b' = 0,  phi_acc = phi + w_a
 *
 * Feng et al. 2011, equations (1) to (5); DESIGN.md, "Numbers", has every format and rounding. Bias is kept
 * in turns per step, so that A = [[1, -1], [0, 1]]. Covariances are 64-bit integers in a unit that the host
 * chooses for each parameter set; p01 and p11 are scaled by 2^s and 2^2s, which makes the off-diagonal of A
 * -2^-s.
 *
 * Cost: a constant number of instructions; `plumb bench` counts them. */
#ifndef PLUMB_CORE_KALMAN_H
#define PLUMB_CORE_KALMAN_H

#include <stdint.h>

/* Settings of one period, from the host. 64-bit values are low word first. */
typedef struct {
    uint32_t rate_current; /* 1: the current gyro sample is U(k); 0: the previous one, as the source prints */
    uint32_t covariance_shift; /* s, 1..15 */
    int32_t dt_s_q34;          /* 500 us .. 100 ms */
    int32_t rate_hz_q19;       /* 1/dt */
    int32_t bias_limit_q30;    /* |bias| in turns per step, <= 2 turn/s */
    uint32_t q00_lo, q00_hi;   /* process noise of the tilt, per step, < 2^56 */
    uint32_t q11_lo, q11_hi;   /* process noise of the bias, per step, < 2^60 */
    uint32_t start_shift;      /* h, 0..31: start_p* are in a unit 2^h coarser, for the first step only */
    int32_t start_tilt_turn_q32;
    int32_t start_bias_q30; /* turns per step */
    uint32_t start_p00_lo, start_p00_hi;
    uint32_t start_p01_lo, start_p01_hi;
    uint32_t start_p11_lo, start_p11_hi;
} kalman_params_t;

/* State. All of it is among the words of a step. */
typedef struct {
    int64_t tilt_turn_q62;       /* wraps at +-2 turns, a multiple of a turn */
    int64_t bias_turn_q62;       /* per step */
    int64_t p00, p01, p11;       /* after the update */
    uint32_t variance;           /* in: R of this step, unit 2^30 times that of p00, 4 .. 2^27 */
    int32_t innovation_turn_q32; /* measured minus predicted, wraps */
    int32_t k0_q30;              /* 0 .. 1 */
    int32_t k1_q30;              /* scaled by 2^s, magnitude < 2 */
    int32_t tilt_turn_q32;       /* out: the estimate */
    int32_t bias_turnps_q28;     /* out */
} kalman_t;

/* Set the start state and covariance. */
void kalman_init(kalman_t *k, const kalman_params_t *p);

/* The first step after kalman_init: like every other, with the start covariance in its coarser unit. */
void kalman_first_step(kalman_t *k, const kalman_params_t *p, int32_t measured_turn_q32,
                       int32_t rate_turnps_q28);

/* One step. k->variance is R of this measurement; |rate| < 6 turn/s. */
void kalman_step(kalman_t *k, const kalman_params_t *p, int32_t measured_turn_q32, int32_t rate_turnps_q28);

#endif
