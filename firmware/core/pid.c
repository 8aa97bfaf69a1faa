#include "pid.h"

void pid_init(pid_t *c) {
    *c = (pid_t){0};
}

bool pid_valid(const pid_params_t *p) {
    const int32_t gain_max = 1 << 30;
    return p->kp_q22 >= -gain_max && p->kp_q22 <= gain_max && p->ki_dt_q22 >= 0 && p->kd_q27 >= -gain_max &&
           p->kd_q27 <= gain_max && p->d_alpha_q31 >= 0 && p->slew_q22 >= 1 && p->slew_q22 <= 2 * PID_ONE_Q22;
}
