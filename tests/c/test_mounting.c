/* Mounting of a sensor: the identity and axis maps to the bit, rounding, limits, and which matrices are
 * refused. */
#include "check.h"
#include "plumb/calibration.h"
#include "plumb/mounting.h"

#define ONE  ((int32_t)PLUMB_MOUNTING_ONE)
#define MOST ((int32_t)PLUMB_CALIBRATION_LIMIT)

static const plumb_mounting_params_t identity = {.xx_q30 = ONE, .yy_q30 = ONE, .zz_q30 = ONE};
static const plumb_mounting_params_t turned = {
    .xy_q30 = ONE, .yx_q30 = -ONE, .zz_q30 = ONE}; /* x from y, y from -x */

static int32_t within_limit(void) {
    const int32_t x = check_random_wild();
    return x > MOST ? MOST : x < -MOST ? -MOST : x;
}

static void axes_are_mapped_to_the_bit(void) {
    for (uint32_t i = 0; i < 100000; i++) {
        const int32_t x = within_limit(), y = within_limit(), z = within_limit();
        int32_t same[3] = {x, y, z}, moved[3] = {x, y, z};
        CHECK(plumb_mounting_apply(&identity, same));
        CHECK(same[0] == x && same[1] == y && same[2] == z);
        CHECK(plumb_mounting_apply(&turned, moved));
        CHECK(moved[0] == y && moved[1] == -x && moved[2] == z);
    }
}

static void it_rounds_to_nearest_and_limits(void) {
    const plumb_mounting_params_t half = {.xx_q30 = ONE / 2, .yy_q30 = ONE, .zz_q30 = ONE};
    int32_t v[3] = {3, -3, 0};
    CHECK(plumb_mounting_apply(&half, v) && v[0] == 2 && v[1] == -3);
    v[0] = -3;
    CHECK(plumb_mounting_apply(&half, v) && v[0] == -1);
    const plumb_mounting_params_t more = {.xx_q30 = ONE + ONE / 2, .yy_q30 = ONE, .zz_q30 = ONE};
    int32_t far[3] = {MOST, MOST, -MOST};
    CHECK(!plumb_mounting_apply(&more, far) && far[0] == MOST && far[1] == MOST && far[2] == -MOST);
    far[0] = -MOST;
    CHECK(!plumb_mounting_apply(&more, far) && far[0] == -MOST);
}

static void what_mounts_no_sensor_is_refused(void) {
    CHECK(plumb_mounting_valid(&identity) && plumb_mounting_valid(&turned));
    const plumb_mounting_params_t none = {0};
    CHECK(!plumb_mounting_valid(&none));
    plumb_mounting_params_t m = identity;
    m.xx_q30 = -ONE; /* mirrored */
    CHECK(!plumb_mounting_valid(&m));
    m = identity;
    m.xy_q30 = ONE; /* its first row sums to 2 */
    CHECK(!plumb_mounting_valid(&m));
    m.xy_q30 = ONE - 1;
    CHECK(plumb_mounting_valid(&m));
    m.xx_q30 = INT32_MIN;
    CHECK(!plumb_mounting_valid(&m));
    m = identity;
    m.zz_q30 = ONE / 2 - 1; /* its determinant is less than half */
    CHECK(!plumb_mounting_valid(&m));
    m.zz_q30 = ONE / 2;
    CHECK(plumb_mounting_valid(&m));
}

int main(void) {
    axes_are_mapped_to_the_bit();
    it_rounds_to_nearest_and_limits();
    what_mounts_no_sensor_is_refused();
    return check_failures > 0;
}
