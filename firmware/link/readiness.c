#include "readiness.h"
#include "arming.h"
#include "generated/used_parts.h"

#define US_Q33 8590U /* 1 us in s Q33, 8 ppm too long; periods are 0.1 s at most */

/* NULL: nothing is plausible or not. */
static const plumb_plausibility_bounds_t *bounds_of(const control_system_t *checked) {
    return USED_CHECKS_AXIS && checked != NULL ? checked->plausibility : NULL;
}

static bool flies(const control_system_t *checked) {
    return USED_CHECKS_FLIGHT && checked != NULL && checked->takeoff != NULL;
}

static bool rolls(const control_system_t *checked) {
    return USED_CHECKS_RIDE && bounds_of(checked) != NULL && checked->plausibility->stopped != 0;
}

#if CONTROL_CHECKS_OWN
static bool checks_itself(const control_system_t *checked) {
    return checked != NULL && (checked->fails | checked->unready) != 0U;
}

/* The setpoint, which is not 0 before arming either, is the word behind the inputs. */
static void follow_own(readiness_t *r, const control_system_t *checked, const uint32_t *words) {
    const uint32_t flags = words[checked->record_words - 2U];
    const unsigned setpoint = words[checked->inputs] != 0U ? PLUMB_PLAUSIBILITY_SETPOINT : 0U;
    const unsigned unready = (flags & checked->unready) != 0U ? READINESS_OWN_UNREADY : 0U;

    r->now.own.failed = (flags & checked->fails) != 0U ? READINESS_OWN_FAILED : 0U;
    r->now.own.missing = (uint16_t)(setpoint | unready);
}
#else
static bool checks_itself(const control_system_t *checked) {
    (void)checked;
    return false;
}

static void follow_own(readiness_t *r, const control_system_t *checked, const uint32_t *words) {
    (void)r, (void)checked, (void)words;
}
#endif

void readiness_begin(readiness_t *r, const control_system_t *system) {
    if (flies(system)) {
        plumb_takeoff_init(&r->now.takeoff);
    } else if (bounds_of(system) != NULL) {
        plumb_plausibility_init(&r->now.plausibility);
    } else if (checks_itself(system)) {
        r->now.own = (readiness_own_t){.missing = PLUMB_PLAUSIBILITY_SETTLING};
    }
    r->disarmed_by = 0;
    r->stopped = 0;
}

static uint16_t failed(const readiness_t *r, const control_system_t *checked) {
    if (flies(checked)) {
        return r->stopped;
    }
    if (checks_itself(checked)) {
        return r->now.own.failed;
    }
    const unsigned stopped = rolls(checked) ? r->stopped : 0U;

    return bounds_of(checked) != NULL ? (uint16_t)(r->now.plausibility.failed | stopped) : 0U;
}

static uint16_t reason(const void *words, uint8_t place) {
    return (uint16_t)(((const uint32_t *)words)[place] << READINESS_STOPPED_SHIFT);
}

void readiness_step(readiness_t *r, const control_system_t *checked, const params_t *params,
                    const void *words, bool armed) {
    const plumb_plausibility_bounds_t *const bounds = bounds_of(checked);

    if (flies(checked)) {
        plumb_takeoff_step(&r->now.takeoff, checked->takeoff, words, US_Q33 * params->period_us);
        r->stopped = reason(words, checked->takeoff->stopped);
    } else if (bounds != NULL) {
        plumb_plausibility_step(&r->now.plausibility, bounds, words, (int32_t)(US_Q33 * params->period_us),
                                params->variance_turn2_q56);
        if (rolls(checked)) {
            r->stopped = reason(words, bounds->stopped);
        }
    } else if (checks_itself(checked)) {
        follow_own(r, checked, words);
    }
    if (armed && failed(r, checked) != 0) {
        r->disarmed_by = failed(r, checked); /* by the next poll */
    }
}

static uint16_t missing(const readiness_t *r, const control_system_t *checked) {
    if (flies(checked)) {
        return (uint16_t)(r->now.takeoff.missing | r->outside);
    }
    if (checks_itself(checked)) {
        return (uint16_t)(r->now.own.missing | r->outside);
    }
    const unsigned outside = rolls(checked) ? r->outside : 0U;

    return bounds_of(checked) != NULL ? (uint16_t)(r->now.plausibility.missing | outside) : 0U;
}

uint16_t readiness_blocked(const readiness_t *r, const control_system_t *checked, bool armed) {
    const unsigned why = failed(r, checked);
    unsigned blocked = 0;

    blocked |= why >> READINESS_STOPPED_SHIFT != 0 ? ARMING_BLOCK_STOPPED : 0U;
    blocked |= (why & ~(~0U << READINESS_STOPPED_SHIFT)) != 0 ? ARMING_BLOCK_IMPLAUSIBLE : 0U;
    blocked |= missing(r, checked) != 0 && !armed ? ARMING_BLOCK_NOT_READY : 0U;
    return (uint16_t)blocked;
}

message_plausibility_t readiness_message(const readiness_t *r, const control_system_t *checked) {
    return (message_plausibility_t){
        .failed = failed(r, checked), .missing = missing(r, checked), .disarmed_by = r->disarmed_by};
}
