/* Binary angles: a table of exact and of worked values, its mirror images, and the corners of the range. */
#include "check.h"
#include "core/angle.h"

#define DEG(x) ((int64_t)((x) * 4294967296.0 / 360.0 + ((x) < 0 ? -0.5 : 0.5)))
#define HALF   (-2147483647 - 1)

static int64_t distance(int32_t a, int64_t b) {
    const int32_t d = (int32_t)((uint32_t)a - (uint32_t)b);
    return d < 0 ? -(int64_t)d : d;
}

/* y, x, angle in degrees (worked from tables of the tangent), in units of 2^-32 turn: 60 is 5e-6 deg */
static void atan2_is(int32_t y, int32_t x, double degrees) {
    CHECK(distance(angle_atan2(y, x), DEG(degrees)) <= 60);
    CHECK(distance(angle_atan2(-y, x), DEG(-degrees)) <= 60);
    CHECK(distance(angle_atan2(y, -x), DEG(180.0 - degrees)) <= 60);
    CHECK(distance(angle_atan2(-y, -x), DEG(degrees - 180.0)) <= 60);
}

static void atan2_table(void) {
    atan2_is(0, 1, 0.0);
    atan2_is(1, 1, 45.0);
    atan2_is(1, 0, 90.0);
    atan2_is(1, 2, 26.56505117707799);
    atan2_is(2, 1, 63.43494882292201);
    atan2_is(3, 4, 36.86989764584402);
    atan2_is(1, 1000, 0.05729576041450061);
    atan2_is(1000000000, 577350269, 60.00000000814856);
    atan2_is(INT32_MAX, INT32_MAX, 45.0);
    atan2_is(INT32_MAX, 1, 89.99999997331958);
    atan2_is(1, INT32_MAX, 2.668042645778635e-08);

    CHECK(angle_atan2(0, 0) == 0);
    CHECK(angle_atan2(0, -1) == HALF && angle_atan2(0, INT32_MIN) == HALF);
    CHECK(distance(angle_atan2(INT32_MIN, INT32_MIN), DEG(-135.0)) <= 60);
    CHECK(distance(angle_atan2(INT32_MIN, 0), DEG(-90.0)) <= 60);
    CHECK(distance(angle_atan2(-1, INT32_MIN), DEG(-180.0)) <= 60);
}

/* The scale of the vector does not matter, and the sign of y is the sign of the angle. */
static void atan2_scale(void) {
    for (int i = 0; i < 100000; i++) {
        const int32_t y = check_random_wild() / 65536, x = check_random_wild() / 65536;
        const int32_t turn = angle_atan2(y, x);
        CHECK(turn == angle_atan2(y * 65536, x * 65536));
        CHECK(y == 0 || x == 0 || (turn == HALF ? x < 0 : (turn == 0 || (turn < 0) == (y < 0))));
    }
}

static void asin_is(int32_t x_q30, double degrees) {
    CHECK(distance(angle_asin(x_q30), DEG(degrees)) <= 84); /* 7e-6 deg */
    CHECK(x_q30 == 0 || angle_asin(-x_q30) == -angle_asin(x_q30));
}

static void asin_table(void) {
    asin_is(0, 0.0);
    asin_is(536870912, 30.0);
    asin_is(759250125, 45.00000000045185);  /* sqrt(1/2) */
    asin_is(929887697, 60.00000003310084);  /* sqrt(3)/2 */
    asin_is(186453311, 9.999999998788127);  /* sin 10 deg */
    asin_is(1057429273, 79.99999999733583); /* sin 80 deg */
    asin_is(1073741823, 89.99752720738341);
    asin_is(1073741824, 90.0);
    CHECK(angle_asin(1073741824) == 1073741824);
    CHECK(angle_asin(1073741825) == 1073741824 && angle_asin(INT32_MAX) == 1073741824);
    CHECK(angle_asin(INT32_MIN) == -1073741824);
}

/* Grows with the sine, but for the stated error. */
static void asin_grows(void) {
    int32_t last = angle_asin(-1073741824);
    for (int32_t x = -1073741824 + 4093; x < 1073741824 - 4093; x += 4093) {
        const int32_t now = angle_asin(x);
        CHECK(now > last - 84);
        last = now;
    }
}

int main(void) {
    atan2_table();
    atan2_scale();
    asin_table();
    asin_grows();
    return check_failures != 0;
}
