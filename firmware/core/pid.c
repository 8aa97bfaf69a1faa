#include "pid.h"

void plumb_pid_init(plumb_pid_t *c) {
    *c = (plumb_pid_t){0};
}

bool plumb_pid_valid(const plumb_pid_params_t *p) {
    const int32_t gain_max = 1 << 30;
    return p->kp_q22 >= -gain_max && p->kp_q22 <= gain_max && p->ki_dt_q22 >= 0 && p->kd_q27 >= -gain_max &&
           p->kd_q27 <= gain_max && p->d_alpha_q31 >= 0 && p->slew_q22 >= 1 &&
           p->slew_q22 <= 2 * PLUMB_PID_ONE_Q22;
}
