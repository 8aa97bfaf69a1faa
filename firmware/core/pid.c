#include "pid.h"

SELDOM_CALLED void plumb_pid_init(plumb_pid_t *c) {
    *c = (plumb_pid_t){0};
}

/* Amount that a step adds to the integral, at the last error and rate. */
SELDOM_CALLED static int32_t direct_part(const plumb_pid_t *c, const plumb_pid_params_t *p) {
    return mulhi_i32(c->error_turn_q32, p->kp_q22) - mulhi_i32(c->rate_filtered_turnps_q27, p->kd_q27);
}

SELDOM_CALLED void plumb_pid_retune(plumb_pid_t *c, const plumb_pid_params_t *from,
                                    const plumb_pid_params_t *to) {
    const int64_t upper = (int64_t)hi_i64(c->integral_q54) + direct_part(c, from) - direct_part(c, to);
    if (to->ki_dt_q22 != 0) {
        c->integral_q54 = make_i64(SATURATE(sat_i32(upper), 24), lo_u64((uint64_t)c->integral_q54));
    }
}

SELDOM_CALLED bool plumb_pid_valid(const plumb_pid_params_t *p) {
    const int32_t gain_max = 1 << 30;
    return p->kp_q22 >= -gain_max && p->kp_q22 <= gain_max && p->ki_dt_q22 >= 0 && p->kd_q27 >= -gain_max &&
           p->kd_q27 <= gain_max && p->d_alpha_q31 >= 0 && p->slew_q22 >= 1 &&
           p->slew_q22 <= 2 * PLUMB_PID_ONE_Q22;
}
