#include "plumb/mounting.h"
#include "fixed.h"
#include "plumb/calibration.h"

#define HALF_Q30  (1L << 29)
#define TWO_Q30   (1LL << 31)
#define ONE_Q58   (1LL << 58)
#define LIMIT_Q26 ((uint32_t)(PLUMB_CALIBRATION_LIMIT >> 2))

/* One component: m Q30 times v, rounded to nearest, limited. Entries of a valid row sum to less than 2^31, so
 * that the products sum to less than 2^62. */
static int32_t component(int32_t m0, int32_t m1, int32_t m2, const int32_t v[3], bool *within) {
    const int64_t sum_q58 = mul_i64(m0, v[0]) + mul_i64(m1, v[1]) + mul_i64(m2, v[2]) + HALF_Q30;
    const int64_t exact = asr64(sum_q58, 30);
    if ((uint32_t)hi_i64(sum_q58) + LIMIT_Q26 <
        2U * LIMIT_Q26) { /* surely within: one comparison of 32 bits */
        return (int32_t)exact;
    }
    if (exact > PLUMB_CALIBRATION_LIMIT || exact < -PLUMB_CALIBRATION_LIMIT) {
        *within = false;
        return exact > 0 ? (int32_t)PLUMB_CALIBRATION_LIMIT : -(int32_t)PLUMB_CALIBRATION_LIMIT;
    }
    return (int32_t)exact;
}

bool plumb_mounting_apply(const plumb_mounting_params_t *p, int32_t v[3]) {
    const int32_t sensed[3] = {v[0], v[1], v[2]};
    bool within = true;
    v[0] = component(p->xx_q30, p->xy_q30, p->xz_q30, sensed, &within);
    v[1] = component(p->yx_q30, p->yy_q30, p->yz_q30, sensed, &within);
    v[2] = component(p->zx_q30, p->zy_q30, p->zz_q30, sensed, &within);
    return within;
}

/* The absolute values of a row sum to less than 2. */
SELDOM_CALLED static bool row_valid(int32_t a, int32_t b, int32_t c) {
    return (int64_t)abs_u32(a) + abs_u32(b) + abs_u32(c) < TWO_Q30;
}

/* a d - b c, Q28; of two valid rows it is below 2^30. */
static int32_t minor_q28(int32_t a, int32_t b, int32_t c, int32_t d) {
    return (int32_t)asr64(mul_i64(a, d) - mul_i64(b, c), 32);
}

SELDOM_CALLED bool plumb_mounting_valid(const plumb_mounting_params_t *p) {
    if (!row_valid(p->xx_q30, p->xy_q30, p->xz_q30) || !row_valid(p->yx_q30, p->yy_q30, p->yz_q30) ||
        !row_valid(p->zx_q30, p->zy_q30, p->zz_q30)) {
        return false;
    }
    const int64_t determinant_q58 =
        mul_i64(p->xx_q30, minor_q28(p->yy_q30, p->yz_q30, p->zy_q30, p->zz_q30)) -
        mul_i64(p->xy_q30, minor_q28(p->yx_q30, p->yz_q30, p->zx_q30, p->zz_q30)) +
        mul_i64(p->xz_q30, minor_q28(p->yx_q30, p->yy_q30, p->zx_q30, p->zy_q30));
    return determinant_q58 >= ONE_Q58 / 2 && determinant_q58 <= 2 * ONE_Q58;
}
