#include "attitude_turns.h"
#include "plumb/angle.h"

#define TWELFTH_Q32      357913941
#define TWENTIETH_Q32    214748365
#define THIRTIETH_Q32    143165577
#define FORTY_SECOND_Q32 102261126

SELDOM PART void plumb_attitude_turn_earth(plumb_quaternion_t *q, int32_t w, int32_t x, int32_t y) {
    const int32_t qw =
        wrap_i32((uint32_t)(mulhi_i32(w, q->w) - mulhi_i32(x, q->x) - mulhi_i32(y, q->y)) << 2);
    const int32_t qx =
        wrap_i32((uint32_t)(mulhi_i32(w, q->x) + mulhi_i32(x, q->w) + mulhi_i32(y, q->z)) << 2);
    const int32_t qy =
        wrap_i32((uint32_t)(mulhi_i32(w, q->y) + mulhi_i32(y, q->w) - mulhi_i32(x, q->z)) << 2);
    const int32_t qz =
        wrap_i32((uint32_t)(mulhi_i32(w, q->z) + mulhi_i32(x, q->y) - mulhi_i32(y, q->x)) << 2);
    const int32_t square_q28 = mulhi_i32(qw, qw) + mulhi_i32(qx, qx) + mulhi_i32(qy, qy) + mulhi_i32(qz, qz);
    const int32_t longer_q32 = ((1 << 28) - square_q28) * 8; /* (1 - |q|^2) / 2 */

    q->w = qw + mulhi_i32(qw, longer_q32);
    q->x = qx + mulhi_i32(qx, longer_q32);
    q->y = qy + mulhi_i32(qy, longer_q32);
    q->z = qz + mulhi_i32(qz, longer_q32);
}

SELDOM PART uint32_t plumb_attitude_align(plumb_quaternion_t *q, int32_t x, int32_t y, int32_t z,
                                          uint32_t least) {
    const uint32_t half = plumb_angle_length((int32_t)plumb_angle_length(y, x), asr32(z, 1)) << 1;
    if (half < least) {
        return half;
    }

    /* half of: (|a| + z, y, -x), the quaternion that turns a to the vertical, of any length */
    const int32_t w = (int32_t)half + asr32(z, 1), qx = asr32(y, 1), qy = -asr32(x, 1);
    const uint32_t length = plumb_angle_length((int32_t)plumb_angle_length(qy, qx), asr32(w, 1)) << 2;
    if (length < half >> 8) { /* upside down: any half turn will do */
        plumb_attitude_turn_earth(q, 0, ONE_Q30, 0);
        return half;
    }
    const unsigned n = clz32(length);
    const int32_t inverse = (int32_t)reciprocal_q61(length << n >> 1); /* 2^(62 - n) / length */
    plumb_attitude_turn_earth(q, (int32_t)asr64(mul_i64(w, inverse), 32U - n),
                              (int32_t)asr64(mul_i64(qx, inverse), 32U - n),
                              (int32_t)asr64(mul_i64(qy, inverse), 32U - n));
    return half;
}

SELDOM PART void plumb_attitude_turn_force(int32_t force[3], int32_t x_q32, int32_t y_q32) {
    const int32_t fx = force[0], fy = force[1], fz = force[2];
    force[0] = add_wrap(fx, mulhi_i32(y_q32, fz));
    force[1] = sub_wrap(fy, mulhi_i32(x_q32, fz));
    force[2] = add_wrap(fz, sub_wrap(mulhi_i32(x_q32, fy), mulhi_i32(y_q32, fx)));
}

SHARED PART uint32_t plumb_attitude_turn_body(plumb_quaternion_t *q, int32_t hx, int32_t hy, int32_t hz) {
    const uint32_t square =
        ((uint32_t)mulhi_i32(hx, hx) + (uint32_t)mulhi_i32(hy, hy) + (uint32_t)mulhi_i32(hz, hz)) >> 2;
    const int32_t s = any_i32((int32_t)square);
    const int32_t sine =
        ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, FORTY_SECOND_Q32)), TWENTIETH_Q32);
    const int32_t missing_q32 = 4 * mulhi_i32(4 * mulhi_i32(s, sine), SIXTH_Q32); /* 1 - sin(h) / h */
    const int32_t cosine =
        ONE_Q30 - mulhi_i32(4 * mulhi_i32(s, ONE_Q30 - mulhi_i32(s, THIRTIETH_Q32)), TWELFTH_Q32);
    const int32_t c = -8 * mulhi_i32(s, cosine); /* cos(h) - 1, Q32 */
    const int32_t x = hx - mulhi_i32(hx, missing_q32);
    const int32_t y = hy - mulhi_i32(hy, missing_q32);
    const int32_t z = hz - mulhi_i32(hz, missing_q32);
    int32_t qw = q->w, qx = q->x, qy = q->y, qz = q->z;
    LOADED4(qw, qx, qy, qz);
    q->w = qw + mulhi_i32(qw, c) - mulhi_i32(qx, x) - mulhi_i32(qy, y) - mulhi_i32(qz, z);
    q->x = qx + mulhi_i32(qx, c) + mulhi_i32(qw, x) + mulhi_i32(qy, z) - mulhi_i32(qz, y);
    q->y = qy + mulhi_i32(qy, c) + mulhi_i32(qw, y) + mulhi_i32(qz, x) - mulhi_i32(qx, z);
    q->z = qz + mulhi_i32(qz, c) + mulhi_i32(qw, z) + mulhi_i32(qx, y) - mulhi_i32(qy, x);
    return square;
}

SHARED PART void plumb_attitude_matrix_of(const plumb_quaternion_t *q, int32_t m[9]) {
    int32_t w = q->w, x = q->x, y = q->y, z = q->z;
    LOADED4(w, x, y, z);
    const int32_t xx = mulhi_i32(x, x), yy = mulhi_i32(y, y), zz = mulhi_i32(z, z);
    const int32_t xy = mulhi_i32(x, y), xz = mulhi_i32(x, z), yz = mulhi_i32(y, z);
    const int32_t wx = mulhi_i32(w, x), wy = mulhi_i32(w, y), wz = mulhi_i32(w, z);
    m[0] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(yy + zz) << 3));
    m[1] = wrap_i32((uint32_t)(xy - wz) << 3);
    m[2] = wrap_i32((uint32_t)(xz + wy) << 3);
    m[3] = wrap_i32((uint32_t)(xy + wz) << 3);
    m[4] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(xx + zz) << 3));
    m[5] = wrap_i32((uint32_t)(yz - wx) << 3);
    m[6] = wrap_i32((uint32_t)(xz - wy) << 3);
    m[7] = wrap_i32((uint32_t)(yz + wx) << 3);
    m[8] = sub_wrap(ONE_Q30, wrap_i32((uint32_t)(xx + yy) << 3));
}
