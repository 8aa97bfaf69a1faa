#include "arming_reasons.h"

bool session_armed(const session_t *s) {
    return arming_armed(&s->arming);
}

const control_system_t *session_checked(const session_t *s) {
    return USED_ACTUATORS && s->run.mode == RUN_REALTIME ? s->system : NULL;
}

bool session_actuator_present(const session_t *s) {
    static const uint8_t pins[] = BOARD_PINS_BY_OUTPUT;

    return USED_ACTUATORS && (s->status.faults & BOARD_FAULT_STRAP) == 0 &&
           s->board->pins == pins[s->system->output];
}

#if USED_RECEIVER
bool session_has_receiver(const session_t *s) {
    return s->params->receiver != 0U && s->system->has_receiver;
}
#endif

bool session_piloted(const session_t *s) {
    return session_has_receiver(s) && arming_armed(&s->arming) && s->arming.by_switch;
}

bool session_flown(const session_t *s) {
    return session_piloted(s) && s->system->takeoff != NULL;
}

static bool faulty(const session_t *s) {
    const unsigned blocking = session_flown(s) ? SESSION_FAULTS_FLOWN : SESSION_FAULTS_BLOCKING;

    return (s->status.faults & blocking) != 0 || s->step_overdue;
}

/* A pilot may not raise the throttle, nor anyone move the vehicle, before the rotors turn. */
static bool past_takeoff(const session_t *s) {
    return session_flown(s) ? arming_driving(&s->arming) : arming_armed(&s->arming);
}

uint16_t session_arming_blocked(const session_t *s, link_t link) {
    const routing_link_t *const l = link != LINK_NONE ? &s->routing.link[link] : NULL;
    const run_mode_t mode = s->run.mode;
    unsigned blocked = 0;

    blocked |= l != NULL && l->greeted ? 0U : ARMING_BLOCK_HELLO;
    blocked |= mode == RUN_IDLE ? ARMING_BLOCK_IDLE : 0U;
    blocked |= mode == RUN_LOCKSTEP ? ARMING_BLOCK_LOCKSTEP : 0U;
    blocked |= faulty(s) ? ARMING_BLOCK_FAULT : 0U;
    blocked |= l != NULL && l->open && !l->read_only ? 0U : ARMING_BLOCK_CLOSED;
    blocked |= mode != RUN_IDLE && s->run.links.owner != link ? ARMING_BLOCK_OWNER : 0U;
    blocked |= run_injected(&s->run) && injected_stale(&s->run.injected) ? ARMING_BLOCK_SAMPLES : 0U;
    blocked |= session_actuator_present(s) ? 0U : ARMING_BLOCK_PINS;
    blocked |= session_has_receiver(s) ? 0U : arming_switch_owns(&s->arming);
    blocked |= s->system->output != CONTROL_OUTPUT_NONE && s->staging.unsafe != PARAMS_COUNT
                   ? ARMING_BLOCK_PARAMETER
                   : 0U;
    blocked |= readiness_blocked(&s->readiness, session_checked(s), past_takeoff(s));
    return (uint16_t)blocked;
}

uint32_t session_hold_us(const session_t *s) {
    return 1000U * s->params->arm_hold_ms;
}

bool session_arm(session_t *s, const request_t *q, uint16_t *blocked) {
    *blocked = session_arming_blocked(s, q->link);
    /* Hosts before protocol version 3 send no asker. On a bus that a host of this version has greeted, such a
     * host is still refused. */
    *blocked |= (uint16_t)(s->nonce[q->link].asker == 0 ? ARMING_BLOCK_HELLO : 0U);
    if (*blocked == 0) {
        s->bootloader_asked = false;
    }
    return arming_arm(&s->arming, *blocked, session_hold_us(s), q->now_us);
}

void session_link_lost(session_t *s, link_t link, uint16_t cause) {
    if (s->run.links.owner == link) {
        arming_disarm_host(&s->arming, cause);
    }
}
