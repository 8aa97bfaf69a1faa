#include "quadrotor_mixer.h"

#define FULL_Q24      (1 << 24)
#define ONE_Q28       (1 << 28)
#define UPTURNED_Q28  (1 << 22) /* 1 + cosine of the error: within 10 deg of upside down */
#define ERROR_MAX_Q28 (1 << 29)

/* Demand of a stick: its position, Q15, times the demand at full deflection. */
KERNEL int32_t by_stick(int32_t stick_q15, int32_t full) {
    return 2 * mulhi_i32(stick_q15 * 65536, full);
}

/* Error of the vertical about each axis: the cross product of wanted and estimated; beyond a right angle, the
 * tangent of half the angle. */
KERNEL void lean_error(int32_t error_q28[3], const int32_t up[3], int32_t wx, int32_t wy) {
    const int32_t s = 4 * (mulhi_i32(wx, wx) + mulhi_i32(wy, wy));
    const int32_t s2 = mulhi_i32(s, s), s3 = mulhi_i32(4 * s2, s);
    const int32_t wz = 4 * (ONE_Q28 - asr32(s, 3) - asr32(s2, 3) - asr32(s3, 4)); /* root of 1 - s */
    const int32_t ux = up[0], uy = up[1], uz = up[2];
    int32_t ex = mulhi_i32(wy, uz) - mulhi_i32(wz, uy);
    int32_t ey = mulhi_i32(wz, ux) - mulhi_i32(wx, uz);
    int32_t ez = mulhi_i32(wx, uy) - mulhi_i32(wy, ux);
    const int32_t n = ONE_Q28 + mulhi_i32(wx, ux) + mulhi_i32(wy, uy) + mulhi_i32(wz, uz);
    if (n < UPTURNED_Q28) {
        ex = ERROR_MAX_Q28, ey = 0, ez = 0;
    } else if (n < ONE_Q28) {
        const int32_t k = (int32_t)udiv32(0xFFFFFFFFU, (uint32_t)n >> 10);
        ex = (int32_t)within_i64(asr64(mul_i64(ex, k), 14), ERROR_MAX_Q28);
        ey = (int32_t)within_i64(asr64(mul_i64(ey, k), 14), ERROR_MAX_Q28);
        ez = (int32_t)within_i64(asr64(mul_i64(ez, k), 14), ERROR_MAX_Q28);
    }
    error_q28[0] = ex;
    error_q28[1] = ey;
    error_q28[2] = ez;
}

PART_KERNEL void plumb_quadrotor_ask(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                     const int32_t sticks[3], bool levels, int32_t rate_max_q28) {
    const int32_t yaw = by_stick(sticks[2], q->yaw_rate_max_q28), most = asr32(rate_max_q28, 4);
    if (!levels) {
        w->error_q28[0] = w->error_q28[1] = w->error_q28[2] = 0;
        w->asked_turnps_q28[0] = by_stick(sticks[0], q->stick_rate_q28);
        w->asked_turnps_q28[1] = by_stick(sticks[1], q->stick_rate_q28);
        w->asked_turnps_q28[2] = yaw;
        return;
    }
    lean_error(w->error_q28, w->up_q30, -by_stick(sticks[1], q->tilt_max_q30),
               by_stick(sticks[0], q->tilt_max_q30));
    for (unsigned i = 0; i < 3U; i++) {
        w->asked_turnps_q28[i] = 16 * clamp_i32(mulhi_i32(w->error_q28[i], q->tilt_gain_q28), -most, most) +
                                 4 * mulhi_i32(yaw, w->up_q30[i]);
    }
}

PART_KERNEL uint32_t plumb_quadrotor_mix(plumb_quadrotor_words_t *w, const plumb_quadrotor_params_t *q,
                                         const plumb_esc_params_t *esc, bool free) {
    const int32_t idle = q->idle_q24, thrust = w->throttle_q15 * 512;
    const int32_t whole = asr32(FULL_Q24 - idle, 1);
    const int32_t half = free ? whole : clamp_i32(thrust - idle, 0, whole);
    uint32_t flags = 0;

    int32_t r = clamp_i32(w->roll.demand_q24, -FULL_Q24, FULL_Q24);
    int32_t p = clamp_i32(w->pitch.demand_q24, -FULL_Q24, FULL_Q24);
    const uint32_t sum = abs_u32(r) + abs_u32(p);
    if (sum > (uint32_t)half) {
        const int32_t share = (int32_t)udiv32((uint32_t)half << 8, (sum >> 7) + 1U);
        r = (int32_t)asr64(mul_i64(r, share), 15);
        p = (int32_t)asr64(mul_i64(p, share), 15);
        flags |= PLUMB_QUADROTOR_FLAG_TILT_LIMITED;
    }
    const int32_t a = (int32_t)abs_u32(r), b = (int32_t)abs_u32(p);
    const int32_t most = clamp_i32(half - (free ? max_i32(a, b) : a + b), 0, q->yaw_max_q24);
    const int32_t y = clamp_i32(w->yaw.demand_q24, -most, most);
    flags |= y != w->yaw.demand_q24 ? PLUMB_QUADROTOR_FLAG_YAW_LIMITED : 0U;

    const int32_t m[4] = {y - r - p, r - p - y, r + p + y, p - r - y};
    const int32_t least = min_i32(min_i32(m[0], m[1]), min_i32(m[2], m[3]));
    const int32_t greatest = max_i32(max_i32(m[0], m[1]), max_i32(m[2], m[3]));
    const int32_t moved = min_i32(max_i32(thrust, idle - least), FULL_Q24 - greatest);
    flags |= moved != thrust ? PLUMB_QUADROTOR_FLAG_THRUST_MOVED : 0U;
    for (unsigned i = 0; i < 4U; i++) {
        const int32_t rotor = clamp_i32(moved + m[i], idle, FULL_Q24);
        const int32_t longer = asr32(asr32(rotor, 8) * esc->span_halfus + (1 << 15), 16);
        w->rotor_q24[i] = rotor;
        w->pulse_halfus[i] = (uint32_t)clamp_i32(esc->mid_halfus + longer, esc->min_halfus, esc->max_halfus);
    }
    w->thrust_q24 = moved;
    w->roll.excess_q24 = w->roll.demand_q24 - r;
    w->pitch.excess_q24 = w->pitch.demand_q24 - p;
    w->yaw.excess_q24 = w->yaw.demand_q24 - y;
    return flags;
}

PART_KERNEL void plumb_quadrotor_rest(plumb_quadrotor_words_t *w, const plumb_esc_params_t *esc) {
    for (unsigned i = 0; i < 4U; i++) {
        w->rotor_q24[i] = 0;
        w->pulse_halfus[i] = (uint32_t)esc->neutral_halfus;
    }
    w->thrust_q24 = 0;
    w->roll.excess_q24 = w->pitch.excess_q24 = w->yaw.excess_q24 = 0;
}
