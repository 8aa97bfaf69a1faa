#include "rate_loop.h"

#define GAIN_MAX (1 << 30)

static bool is_gain(int32_t gain) {
    return gain >= 0 && gain <= GAIN_MAX;
}

SELDOM_CALLED bool plumb_rate_loop_valid(const plumb_rate_loop_params_t *p) {
    return is_gain(p->kp_q29) && is_gain(p->kd_q28) && is_gain(p->ff_q29) && p->ki_dt_q35 >= 0;
}
