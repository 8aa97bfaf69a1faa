#include "readiness.h"
#include "arming.h"
#include "generated/used_parts.h"

#define US_Q33 8590U /* 1 us in s Q33, 8 ppm too long; periods are 0.1 s at most */

#define USED_PLAUSIBILITY (USED_PULSES || USED_BRIDGE)

/* NULL: nothing is plausible or not. */
static const plumb_plausibility_bounds_t *bounds_of(const control_system_t *checked) {
    return USED_PLAUSIBILITY && checked != NULL ? checked->plausibility : NULL;
}

static bool flies(const control_system_t *checked) {
    return USED_ROTORS && checked != NULL && checked->takeoff != NULL;
}

void readiness_begin(readiness_t *r, const control_system_t *system) {
    if (flies(system)) {
        plumb_takeoff_init(&r->now.takeoff);
    } else if (bounds_of(system) != NULL) {
        plumb_plausibility_init(&r->now.plausibility);
    }
    r->disarmed_by = 0;
    r->stopped = 0;
}

static uint16_t failed(const readiness_t *r, const control_system_t *checked) {
    if (flies(checked)) {
        return r->stopped;
    }
    return bounds_of(checked) != NULL ? r->now.plausibility.failed : 0U;
}

void readiness_step(readiness_t *r, const control_system_t *checked, const params_t *params,
                    const void *words, bool armed) {
    const plumb_plausibility_bounds_t *const bounds = bounds_of(checked);

    if (flies(checked)) {
        const uint32_t why = ((const uint32_t *)words)[checked->takeoff->stopped];

        plumb_takeoff_step(&r->now.takeoff, checked->takeoff, words, US_Q33 * params->period_us);
        r->stopped = (uint16_t)(why << READINESS_STOPPED_SHIFT);
    } else if (bounds != NULL) {
        plumb_plausibility_step(&r->now.plausibility, bounds, words, (int32_t)(US_Q33 * params->period_us),
                                params->variance_turn2_q56);
    }
    if (armed && failed(r, checked) != 0) {
        r->disarmed_by = failed(r, checked); /* by the next poll */
    }
}
static uint16_t missing(const readiness_t *r, const control_system_t *checked) {
    if (flies(checked)) {
        return (uint16_t)(r->now.takeoff.missing | r->outside);
    }
    return bounds_of(checked) != NULL ? r->now.plausibility.missing : 0U;
}

uint16_t readiness_blocked(const readiness_t *r, const control_system_t *checked, bool armed) {
    const unsigned by_check = flies(checked) ? ARMING_BLOCK_STOPPED : ARMING_BLOCK_IMPLAUSIBLE;
    unsigned blocked = 0;

    blocked |= failed(r, checked) != 0 ? by_check : 0U;
    blocked |= missing(r, checked) != 0 && !armed ? ARMING_BLOCK_NOT_READY : 0U;
    return (uint16_t)blocked;
}

message_plausibility_t readiness_message(const readiness_t *r, const control_system_t *checked) {
    return (message_plausibility_t){
        .failed = failed(r, checked), .missing = missing(r, checked), .disarmed_by = r->disarmed_by};
}
