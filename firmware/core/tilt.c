#include "tilt.h"
#include "angle.h"

#define ONE_G_Q26    (1L << 26)
#define ONE_G2_Q20   (1L << 20)
#define VARIANCE_MAX 0x1000000UL /* 2^24, as the filter wants it */

int32_t tilt_angle(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26, uint32_t *limited) {
    *limited = 0;
    if (p->mode == TILT_ATAN2)
        return angle_atan2(accel_y_g_q26, accel_z_g_q26);
    const int32_t sine_q26 = clamp_i32(accel_y_g_q26, -ONE_G_Q26, ONE_G_Q26);
    *limited = sine_q26 != accel_y_g_q26;
    return angle_asin(sine_q26 * 16);
}

uint32_t tilt_variance(const tilt_params_t *p, int32_t accel_y_g_q26, int32_t accel_z_g_q26) {
    const int64_t square =
        add64_wrap(mul_i64(accel_y_g_q26, accel_y_g_q26), mul_i64(accel_z_g_q26, accel_z_g_q26));
    const uint32_t deviation_q20 = abs_u32(sub_wrap(hi_i64(square), ONE_G2_Q20));
    const uint32_t d = min_u32(deviation_q20, p->deviation_max) << p->deviation_shift;
    return min_u32(p->r_base + mulhi_u32(mulhi_u32(d, d), p->r_gain), p->r_max);
}

bool tilt_valid(const tilt_params_t *p) {
    if (p->mode > TILT_ATAN2 || p->deviation_shift > 31U ||
        p->deviation_max > UINT32_MAX >> p->deviation_shift)
        return false;
    const uint32_t d = p->deviation_max << p->deviation_shift;
    return p->r_base >= 1U && p->r_base <= p->r_max && p->r_max <= VARIANCE_MAX &&
           mulhi_u32(mulhi_u32(d, d), p->r_gain) <= UINT32_MAX - p->r_base;
}
