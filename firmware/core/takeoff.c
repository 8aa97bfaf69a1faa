#include "plumb/takeoff.h"
#include "fixed.h"
#include <stdbool.h>

#define READY_S_Q33 2576980377U /* 300 ms */
#define RATE_MAX    (1U << 29)  /* 2 turn/s Q28: with it the difference to the mean fits int32 */

SELDOM_CALLED void plumb_takeoff_init(plumb_takeoff_t *t) {
    *t = (plumb_takeoff_t){.missing = PLUMB_TAKEOFF_MISSING_ALL};
}

void plumb_takeoff_step(plumb_takeoff_t *t, const plumb_takeoff_bounds_t *bounds, const void *record,
                        uint32_t dt_s_q33) {
    const plumb_takeoff_bounds_t *const b = bounds;
    const int32_t *const word = record;
    const int32_t *const rate = &word[b->rate];
    const uint32_t fastest = ((uint32_t)word[b->flags] & b->blind) != 0U
                                 ? RATE_MAX
                                 : max_u32(max_u32(abs_u32(rate[0]), abs_u32(rate[1])), abs_u32(rate[2]));
    const int32_t apart = wrap_i32(min_u32(fastest, RATE_MAX) - t->rate_mean_turnps_q28);
    const int32_t share_q32 = wrap_i32(2U * dt_s_q33); /* dt / 0.25 s */
    const bool stands = ((uint32_t)word[b->flags] & b->stands) == b->stands;
    unsigned missing = 0;

    t->rate_mean_turnps_q28 += (uint32_t)mulhi_i32(apart, share_q32);
    missing |= stands && t->rate_mean_turnps_q28 <= b->rest_turnps_q28 ? 0U : PLUMB_TAKEOFF_MOVING;
    missing |= (uint32_t)word[b->variance] <= b->variance_max_rad2_q32 ? 0U : PLUMB_TAKEOFF_CONVERGING;
    missing |= word[b->throttle] <= b->throttle_max_q15 ? 0U : PLUMB_TAKEOFF_SETPOINT;
    missing |= word[b->up_z] >= b->up_z_min_q30 ? 0U : PLUMB_TAKEOFF_TILTED;
    t->ready_s_q33 = missing == 0U ? min_u32(t->ready_s_q33 + dt_s_q33, READY_S_Q33) : 0U;
    missing |= t->ready_s_q33 >= READY_S_Q33 ? 0U : PLUMB_TAKEOFF_SETTLING;
    t->missing = missing;
}
