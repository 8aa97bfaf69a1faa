#include "wheel.h"

SELDOM_CALLED bool plumb_wheel_valid(const plumb_wheel_params_t *p) {
    return p->edges_max >= 1 && p->edges_max <= INT16_MAX && p->alpha_q31 >= 0 && p->accel_gain_q30 >= 0 &&
           mul_u64((uint32_t)p->edges_max, abs_u32(p->edge_mps_q26)) <= (uint64_t)WHEEL_SPEED_LIMIT;
}
