/* Kalman filter of two states, tilt and gyro bias, with the full covariance and a measurement variance R of
 * its own at every step. The equations are numbered as the sources print them; P = [[p00, p01], [p01, p11]],
 * K = [k0, k1].
 *
 *     phi' = phi + dt (omega - b),  b' = b,  z = phi + noise of variance R
 *     (1) X = A X + B U
 *     (2) P = A P A^T + Q
 *     (3) X = X + K (z - phi)
 *     (4) K = P H^T / (p00 + R)
 *     (5) P = (I - K H) P
 *
 * The state holds the bias per step (turn, not turn/s): then A = [[1, -1], [0, 1]], and the covariance needs
 * no product with dt. Covariances are in lsb, a unit that each parameter set chooses (plumb/design.h; about
 * 2^-56 of its largest variance): p00, p01, p11 are 64-bit integers, p11 and its process noise have 30 more
 * bits of fraction, and r is in 2^32 lsb. docs/reference/arithmetic/kernels.md shows that every sum fits.
 */
#ifndef PLUMB_KALMAN_H
#define PLUMB_KALMAN_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_KALMAN_R_MAX 0x1000000UL /* 2^24 */

/* Settings. */
typedef struct {
    int32_t dt_s_q33;          /* period, up to 0.1 s */
    uint32_t rate_now;         /* U(k): 0 the previous gyro sample, as the sources print; 1 the current one;
                                * 2 the mean of both */
    uint32_t qa_hi, qa_lo;     /* Q of the tilt per step, lsb; 0..2^56 */
    uint32_t qb;               /* Q of the bias per step, whole lsb; 0..2^32-1 */
    uint32_t qb_frac_q30;      /* fraction of qb, lsb; 0..2^30-1 */
    int32_t bias_max_turn_q29; /* limit of the published bias, per step; at most 1 turn/s */
    int32_t rate_gain;         /* 2^(31 - rate_shift) / dt, at least 2^30: turn per step -> turn/s */
    uint32_t rate_shift;       /* 1..16 */
} plumb_kalman_params_t;

/* X0 and P0. The bias and both its covariances are per step. */
typedef struct {
    int32_t bias_hi; /* turn Q61 */
    uint32_t bias_lo;
    int32_t tilt_turn_q32;
    uint32_t p00_hi, p00_lo; /* lsb, 0..2^57 */
    int32_t p01_hi;
    uint32_t p01_lo;         /* from -min(p00, 2^56) to min(p00, qa / 4) */
    uint32_t p11_hi, p11_lo; /* 0..2^56-1 */
} plumb_kalman_start_t;

/* State, and what the last step found. */
typedef struct {
    int64_t tilt_turn_q61; /* modulo 8 turns; the angle is its bits 29..60 */
    int64_t bias_turn_q61; /* per step; +-1/8 turn */
    int64_t p00, p01, p11; /* posterior, lsb */
    uint32_t p11_frac_q30;
    int32_t innovation_turn_q32;
    int32_t k0_q29; /* gains of this step */
    int32_t k1_q29; /* turn per step, per turn */
} plumb_kalman_t;

/* State and covariance before the first sample. */
void plumb_kalman_init(plumb_kalman_t *k, const plumb_kalman_start_t *s);

/* Predict with the gyro rate (turn/s Q28, any int32), then correct with the measured tilt (turn Q32, any
 * int32, wraps) of variance r (2^32 lsb, 1 to PLUMB_KALMAN_R_MAX). A constant number of instructions, one
 * division of 32 bits, no branch. p: valid (plumb_kalman_valid). */
void plumb_kalman_step(plumb_kalman_t *k, const plumb_kalman_params_t *p, uint32_t r, int32_t tilt_turn_q32,
                       int32_t rate_turnps_q28);

/* Estimated tilt, turn Q32. */
int32_t plumb_kalman_tilt(const plumb_kalman_t *k);

/* Estimated bias of the gyro, turn/s Q28, within the limit of the parameters. */
int32_t plumb_kalman_bias(const plumb_kalman_t *k, const plumb_kalman_params_t *p);

/* The measurement that the next step with this rate expects, turn Q32: given to it, nothing is corrected. */
int32_t plumb_kalman_predicted(const plumb_kalman_t *k, const plumb_kalman_params_t *p,
                               int32_t rate_turnps_q28);

/* The ranges above, and that the published bias stays below 1 turn/s. */
bool plumb_kalman_valid(const plumb_kalman_params_t *p, const plumb_kalman_start_t *s);

#ifdef __cplusplus
}
#endif

#endif
