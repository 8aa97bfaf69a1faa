/* The body of plumb/wheel.h, inlined into the steps: the manual is there. */
#ifndef PLUMB_CORE_WHEEL_H
#define PLUMB_CORE_WHEEL_H

#include "fixed.h"
#include "plumb/wheel.h"
#include <stdbool.h>

#define WHEEL_SPEED_LIMIT (15L << 26) /* m/s */
#define WHEEL_ACCEL_LIMIT (3L << 26)  /* g */

/* About 30 cycles. */
KERNEL bool wheel_step(plumb_wheel_t *restrict c, const plumb_wheel_params_t *restrict p, int32_t edges) {
    int32_t most = p->edges_max, edge = p->edge_mps_q26;
    LOADED2(most, edge);
    const int32_t used = clamp_i32(edges, -most, most);
    const int32_t speed = used * edge;
    int32_t velocity = c->velocity_mps_q26, alpha = p->alpha_q31, gain = p->accel_gain_q30;
    LOADED3(velocity, alpha, gain);
    const int32_t change = speed - velocity;
    c->speed_mps_q26 = speed;
    c->velocity_mps_q26 = velocity + 2 * mulhi_i32(change, alpha);
    const int32_t accel_q24 = mulhi_i32(change, gain);
    const int32_t limited_q24 = clamp_i32(accel_q24, -(WHEEL_ACCEL_LIMIT >> 2), WHEEL_ACCEL_LIMIT >> 2);
    c->accel_g_q26 = limited_q24 * 4;
    return used != edges || limited_q24 != accel_q24;
}

#endif
