#include "plumb/quaternion.h"
#include "fixed.h"

#define PI_Q29          1686629713 /* pi: half of a rotation in rad, from one in turns */
#define INVERSE_PI_Q32  1367130551
#define EIGHTH_TURN_Q60 ((int64_t)1 << 57)

/* a * b of two Q30, rounded to nearest. */
static int32_t mul_q30(int32_t a, int32_t b) {
    return wrap_i32((uint32_t)asr64(mul_i64(a, b) + (1 << 29), 30));
}

/* p * q, Q30, rounded to nearest. */
static plumb_quaternion_t product(const plumb_quaternion_t *p, const plumb_quaternion_t *q) {
    const int64_t half = 1 << 29;
    const int64_t w = mul_i64(p->w, q->w) - mul_i64(p->x, q->x) - mul_i64(p->y, q->y) - mul_i64(p->z, q->z);
    const int64_t x = mul_i64(p->w, q->x) + mul_i64(p->x, q->w) + mul_i64(p->y, q->z) - mul_i64(p->z, q->y);
    const int64_t y = mul_i64(p->w, q->y) - mul_i64(p->x, q->z) + mul_i64(p->y, q->w) + mul_i64(p->z, q->x);
    const int64_t z = mul_i64(p->w, q->z) + mul_i64(p->x, q->y) - mul_i64(p->y, q->x) + mul_i64(p->z, q->w);
    return (plumb_quaternion_t){
        wrap_i32((uint32_t)asr64(w + half, 30)),
        wrap_i32((uint32_t)asr64(x + half, 30)),
        wrap_i32((uint32_t)asr64(y + half, 30)),
        wrap_i32((uint32_t)asr64(z + half, 30)),
    };
}

void plumb_quaternion_rotate(plumb_quaternion_t *q, const int64_t rotation_turn_q60[3]) {
    int32_t half_q30[3]; /* half the rotation, rad */
    int32_t square = 0;  /* of the length of half_q30 */
    for (unsigned i = 0; i < 3U; i++) {
        const int64_t turn_q60 = within_i64(rotation_turn_q60[i], EIGHTH_TURN_Q60);
        const int32_t turn_q32 = wrap_i32((uint32_t)asr64(turn_q60 + (1 << 27), 28));
        half_q30[i] = wrap_i32((uint32_t)asr64(mul_i64(turn_q32, PI_Q29) + (1 << 30), 31));
        square += mul_q30(half_q30[i], half_q30[i]);
    }
    /* cos h = 1 - h^2/2 + h^4/24 - h^6/720, sin h / h = 1 - h^2/6 + h^4/120 */
    const int32_t fourth = mul_q30(square, square), sixth = mul_q30(fourth, square);
    const int32_t cosine = PLUMB_QUATERNION_ONE - square / 2 + fourth / 24 - sixth / 720;
    const int32_t sinc = PLUMB_QUATERNION_ONE - square / 6 + fourth / 120;
    const plumb_quaternion_t turn = {cosine, mul_q30(half_q30[0], sinc), mul_q30(half_q30[1], sinc),
                                     mul_q30(half_q30[2], sinc)};
    const plumb_quaternion_t r = product(q, &turn);
    /* normalise: q (3 - |q|^2) / 2 */
    const int64_t length = mul_i64(r.w, r.w) + mul_i64(r.x, r.x) + mul_i64(r.y, r.y) + mul_i64(r.z, r.z);
    const int32_t keep = wrap_i32((uint32_t)asr64(((int64_t)3 << 60) - length, 31));
    *q = (plumb_quaternion_t){mul_q30(r.w, keep), mul_q30(r.x, keep), mul_q30(r.y, keep), mul_q30(r.z, keep)};
}

void plumb_quaternion_difference(const plumb_quaternion_t *from, const plumb_quaternion_t *to,
                                 int32_t rotation_turn_q32[3]) {
    const plumb_quaternion_t back = {from->w, -from->x, -from->y, -from->z};
    const plumb_quaternion_t d = product(&back, to);
    const int32_t v[3] = {d.x, d.y, d.z};
    for (unsigned i = 0; i < 3U; i++) {
        const int32_t turn = wrap_i32((uint32_t)asr64(mul_i64(v[i], INVERSE_PI_Q32) + (1 << 29), 30));
        rotation_turn_q32[i] = d.w < 0 ? -turn : turn;
    }
}
