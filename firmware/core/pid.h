/* The body of plumb/pid.h, inlined into the steps: the manual is there, with the equations (1) to (4). */
#ifndef PLUMB_CORE_PID_H
#define PLUMB_CORE_PID_H

#include "fixed.h"
#include "plumb/pid.h"

KERNEL void pid_step(plumb_pid_t *restrict c, const plumb_pid_params_t *restrict p, int32_t error_turn_q32,
                     int32_t rate_turnps_q28) {
    int32_t kp = p->kp_q22, kd = p->kd_q27, alpha = p->d_alpha_q31, last = c->rate_filtered_turnps_q27;
    LOADED4(kp, kd, alpha, last);
    /* Rates are halved, because the difference of two needs one bit more. */
    const int32_t step = sub_wrap(asr32(rate_turnps_q28, 1), last);
    const int32_t rate = add_wrap(last, 2 * mulhi_i32(step, alpha));
    c->rate_filtered_turnps_q27 = rate;

    const uint64_t sum = (uint64_t)c->integral_q54;
    uint32_t sum_lo = lo_u64(sum), sum_hi = hi_u64(sum);
    int32_t held = c->command_q22, slew = p->slew_q22;
    LOADED4(sum_lo, sum_hi, held, slew);
    /* Every command fits 23 bits: extending their sign keeps it within -1..1 even after a bit flip above them
     * (one cycle). */
    const int32_t before = sign_extend(held, 23);
    const int32_t demand = mulhi_i32(error_turn_q32, kp) - mulhi_i32(rate, kd) + wrap_i32(sum_hi);
    const int32_t wanted = SATURATE(demand, 23);
    const int32_t command = before + clamp_i32(wanted - before, -slew, slew);
    c->command_q22 = command;

    /* Integrate, unless the command is limited (excess is not 0) and the error would push it further (it has
     * the sign of excess). */
    const int32_t excess = demand - command;
    c->excess_q22 = excess;
    const int32_t keep = asr32((excess ^ error_turn_q32) | ~(excess | -excess), 31);
    const int64_t integral =
        add64_wrap(wrap_i64(make_u64(sum_hi, sum_lo)), mul_i64(error_turn_q32 & keep, p->ki_dt_q22));
    c->integral_q54 = make_i64(SATURATE(hi_i64(integral), 24), lo_u64((uint64_t)integral));
}

#endif
