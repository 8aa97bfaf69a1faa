#include "pid.h"

void pid_init(pid_t *c) {
    *c = (pid_t){0};
}

void pid_step(pid_t *c, const pid_params_t *p, int32_t error_turn_q32, int32_t rate_turnps_q28) {
    /* halves: the difference of two rates needs one bit more than a rate */
    const int32_t step = asr32(rate_turnps_q28, 1) - c->rate_filtered_turnps_q27;
    const uint64_t moved = (uint64_t)mul_i64(step, p->d_alpha_q31);
    const int32_t rate = add_wrap(c->rate_filtered_turnps_q27, wrap_i32(shl_hi(moved, 1)));
    c->rate_filtered_turnps_q27 = rate;

    const int64_t sum =
        sub64_wrap(add64_wrap(mul_i64(error_turn_q32, p->kp_q22), c->integral_q54), mul_i64(rate, p->kd_q27));
    const int32_t top = clamp_i32(hi_i64(sum), -(1 << 23), (1 << 23) - 1);
    const int32_t demand = wrap_i32((uint32_t)top << 8 | lo_u64((uint64_t)sum) >> 24);

    const int32_t wanted = clamp_i32(demand, p->out_min_q30, p->out_max_q30);
    const int32_t command = c->command_q30 + clamp_i32(wanted - c->command_q30, -p->slew_q30, p->slew_q30);
    c->demand_q30 = demand;
    c->command_q30 = command;
    c->limited = demand != command;

    /* integrate, unless limited and pushing further */
    const int64_t push = mul_i64(error_turn_q32, p->ki_dt_q22);
    const int32_t excess = asr32(demand, 1) - asr32(command, 1);
    const int32_t is_limited = asr32(excess | -excess, 31);
    const uint32_t keep = (uint32_t) ~(is_limited & ~asr32(excess ^ hi_i64(push), 31));
    const uint64_t kept = make_u64((uint32_t)hi_i64(push) & keep, lo_u64((uint64_t)push) & keep);
    const uint64_t integral = (uint64_t)c->integral_q54 + kept;
    c->integral_q54 = make_i64(clamp_i32((int32_t)hi_u64(integral), p->integral_min_q22, p->integral_max_q22),
                               lo_u64(integral));
}

bool pid_valid(const pid_params_t *p) {
    const int32_t gain_max = 1 << 30;
    return p->kp_q22 >= -gain_max && p->kp_q22 <= gain_max && p->kd_q27 >= -gain_max &&
           p->kd_q27 <= gain_max && p->d_alpha_q31 >= 0 && p->integral_min_q22 >= -(1 << 22) &&
           p->integral_min_q22 <= 0 && p->integral_max_q22 >= 0 && p->integral_max_q22 <= 1 << 22 &&
           p->out_min_q30 >= -gain_max && p->out_min_q30 <= p->out_max_q30 && p->out_max_q30 < gain_max &&
           p->slew_q30 >= 1;
}
