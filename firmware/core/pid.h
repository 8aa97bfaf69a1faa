/* Error -> command, with every limit an actuator has.
 *
 *     (1) demand = kp * error + integral - kd * filtered rate     D is of the measured rate
 *     (2) command = demand, limited to +-1 and to +-slew from the last command
 *     (3) integral += ki dt * error, unless (2) limited and this would push it further
 *
 * +-1 is all that the actuator may get: a smaller share is a smaller span of the output and larger gains; the
 * direction is the sign of that span. The integral keeps 64 bits, the sum its upper 32: |kp|, |kd| <= 2^30
 * keep it below 2^30 (pid_valid).
 */
#ifndef PLUMB_CORE_PID_H
#define PLUMB_CORE_PID_H

#include "fixed.h"
#include <stdbool.h>

#define PID_ONE_Q22 (1 << 22) /* full command */

typedef struct {
    int32_t kp_q22;      /* command per turn; +-2^30 */
    int32_t ki_dt_q22;   /* command per turn and step; 0..2^31-1 */
    int32_t kd_q27;      /* command per turn/s; +-2^30 */
    int32_t d_alpha_q31; /* 1 - exp(-dt / tau) of the D filter; 0..2^31-1 (no filter) */
    int32_t slew_q22;    /* largest change per step; 1..2^23 (no limit) */
} pid_params_t;

typedef struct {
    int64_t integral_q54; /* command; +-2, a guard only */
    int32_t command_q22;  /* -1..1-2^-22 */
    int32_t rate_filtered_turnps_q27;
    int32_t excess_q22;     /* demand - command: not 0 when limited */
    int32_t error_turn_q32; /* as given, kept by the caller as a record */
} pid_t;

void pid_init(pid_t *c);

/* error: setpoint - tilt, turn Q32, already wrapped; rate: measured, turn/s Q28. Constant number of
 * instructions. */
KERNEL void pid_step(pid_t *restrict c, const pid_params_t *restrict p, int32_t error_turn_q32,
                     int32_t rate_turnps_q28) {
    int32_t kp = p->kp_q22, kd = p->kd_q27, alpha = p->d_alpha_q31, last = c->rate_filtered_turnps_q27;
    LOADED4(kp, kd, alpha, last);
    /* halves: the difference of two rates needs one bit more than a rate */
    const int32_t step = sub_wrap(asr32(rate_turnps_q28, 1), last);
    const int32_t rate = add_wrap(last, 2 * mulhi_i32(step, alpha));
    c->rate_filtered_turnps_q27 = rate;

    const uint64_t sum = (uint64_t)c->integral_q54;
    uint32_t sum_lo = lo_u64(sum), sum_hi = hi_u64(sum);
    int32_t held = c->command_q22, slew = p->slew_q22;
    LOADED4(sum_lo, sum_hi, held, slew);
    /* -1..1 in any case: 23 bits hold every command, and a flipped bit above them is dropped (one cycle) */
    const int32_t before = sign_extend(held, 23);
    const int32_t demand = mulhi_i32(error_turn_q32, kp) - mulhi_i32(rate, kd) + wrap_i32(sum_hi);
    const int32_t wanted = SATURATE(demand, 23);
    const int32_t command = before + clamp_i32(wanted - before, -slew, slew);
    c->command_q22 = command;

    /* integrate, unless limited (excess is not 0) and pushing further (error has the sign of excess) */
    const int32_t excess = demand - command;
    c->excess_q22 = excess;
    const int32_t keep = asr32((excess ^ error_turn_q32) | ~(excess | -excess), 31);
    const int64_t integral =
        add64_wrap(wrap_i64(make_u64(sum_hi, sum_lo)), mul_i64(error_turn_q32 & keep, p->ki_dt_q22));
    c->integral_q54 = make_i64(SATURATE(hi_i64(integral), 24), lo_u64((uint64_t)integral));
}

bool pid_valid(const pid_params_t *p);

#endif
