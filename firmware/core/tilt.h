/* The body of plumb/tilt.h, inlined into the steps: the manual is there. */
#ifndef PLUMB_CORE_TILT_H
#define PLUMB_CORE_TILT_H

#include "angle.h"
#include "fixed.h"
#include "plumb/tilt.h"

#define TILT_ONE_G_Q26  (1L << 26)
#define TILT_ONE_G2_Q20 (1L << 20)

KERNEL int32_t tilt_angle(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26) {
    if (p->mode == PLUMB_TILT_ARCSINE) {
        return angle_asin(clamp_i32(accel_y_g_q26, -TILT_ONE_G_Q26, TILT_ONE_G_Q26) * 16);
    }
    return angle_atan2(accel_y_g_q26, accel_z_g_q26);
}

KERNEL uint32_t tilt_variance(const plumb_tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26) {
    const int64_t square =
        add64_wrap(mul_i64(accel_y_g_q26, accel_y_g_q26), mul_i64(accel_z_g_q26, accel_z_g_q26));
    const uint32_t deviation_q20 = abs_u32(sub_wrap(hi_i64(square), TILT_ONE_G2_Q20));
    uint32_t limit = p->deviation_max, shift = p->deviation_shift, gain = p->r_gain;
    LOADED3(limit, shift, gain);
    const uint32_t d = min_u32(deviation_q20, limit) << shift;
    uint32_t base = p->r_base, most = p->r_max;
    LOADED2(base, most);
    return min_u32(base + mulhi_u32(mulhi_u32(d, d), gain), most);
}

#endif
