#include "pid.h"

#define ONE_Q22 (1 << 22)

void pid_init(pid_t *c) {
    *c = (pid_t){0};
}

void pid_step(pid_t *restrict c, const pid_params_t *restrict p, int32_t error_turn_q32,
              int32_t rate_turnps_q28) {
    /* -1..1 in any case: 23 bits hold every command, and a flipped bit above them is dropped (one cycle) */
    const int32_t before = sign_extend(c->command_q22, 23);
    /* halves: the difference of two rates needs one bit more than a rate */
    const int32_t last = c->rate_filtered_turnps_q27;
    const int32_t step = sub_wrap(asr32(rate_turnps_q28, 1), last);
    const int32_t rate = add_wrap(last, 2 * mulhi_i32(step, p->d_alpha_q31));
    c->rate_filtered_turnps_q27 = rate;

    const int32_t demand =
        mulhi_i32(error_turn_q32, p->kp_q22) - mulhi_i32(rate, p->kd_q27) + hi_i64(c->integral_q54);
    const int32_t wanted = clamp_i32(demand, -ONE_Q22, ONE_Q22 - 1);
    const int32_t command = before + clamp_i32(wanted - before, -p->slew_q22, p->slew_q22);
    c->command_q22 = command;

    /* integrate, unless limited (excess is not 0) and pushing further (error has the sign of excess) */
    const int32_t excess = demand - command;
    c->excess_q22 = excess;
    const int32_t keep = asr32((excess ^ error_turn_q32) | ~(excess | -excess), 31);
    const int64_t integral = add64_wrap(c->integral_q54, mul_i64(error_turn_q32 & keep, p->ki_dt_q22));
    c->integral_q54 =
        make_i64(clamp_i32(hi_i64(integral), -2 * ONE_Q22, 2 * ONE_Q22 - 1), lo_u64((uint64_t)integral));
}

bool pid_valid(const pid_params_t *p) {
    const int32_t gain_max = 1 << 30;
    return p->kp_q22 >= -gain_max && p->kp_q22 <= gain_max && p->ki_dt_q22 >= 0 && p->kd_q27 >= -gain_max &&
           p->kd_q27 <= gain_max && p->d_alpha_q31 >= 0 && p->slew_q22 >= 1 && p->slew_q22 <= 2 * ONE_Q22;
}
