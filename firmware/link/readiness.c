#include "readiness.h"
#include "arming.h"

#define US_Q33 8590U /* 1 us in s Q33, 8 ppm too long; periods are 0.1 s at most */

void readiness_begin(readiness_t *r) {
    plumb_plausibility_init(&r->plausibility);
    r->disarmed_by = 0;
}

void readiness_step(readiness_t *r, const plumb_plausibility_bounds_t *bounds, const params_t *params,
                    const void *words, bool armed) {
    if (bounds == NULL) {
        return;
    }
    plumb_plausibility_step(&r->plausibility, bounds, words, (int32_t)(US_Q33 * params->period_us),
                            params->variance_turn2_q56);
    if (armed && r->plausibility.failed != 0) {
        r->disarmed_by = r->plausibility.failed; /* by the next poll */
    }
}

uint16_t readiness_blocked(const readiness_t *r, const plumb_plausibility_bounds_t *bounds, bool armed) {
    unsigned blocked = 0;

    if (bounds != NULL) {
        blocked |= r->plausibility.failed != 0 ? ARMING_BLOCK_IMPLAUSIBLE : 0U;
        blocked |= r->plausibility.missing != 0 && !armed ? ARMING_BLOCK_NOT_READY : 0U;
    }
    return (uint16_t)blocked;
}

message_plausibility_t readiness_message(const readiness_t *r, const plumb_plausibility_bounds_t *bounds) {
    const bool known = bounds != NULL;

    return (message_plausibility_t){.failed = known ? r->plausibility.failed : 0U,
                                    .missing = known ? r->plausibility.missing : 0U,
                                    .disarmed_by = r->disarmed_by};
}
