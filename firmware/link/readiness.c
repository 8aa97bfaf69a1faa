#include "readiness.h"
#include "messages.h"

#define US_Q33 8590U /* 1 us in s Q33, 8 ppm too long; periods are 0.1 s at most */

/* What is checked of the system in use; NULL: nothing. */
static const plausibility_bounds_t *checked(const session_t *s) {
    return s->mode == SESSION_REALTIME ? control_plausibility(&s->params->control) : NULL;
}

void readiness_begin(session_t *s) {
    plausibility_init(&s->plausibility);
    s->disarmed_by_checks = 0;
}

void readiness_stepped(session_t *s) {
    const plausibility_bounds_t *const bounds = checked(s);

    if (bounds == NULL) {
        return;
    }
    plausibility_step(&s->plausibility, bounds, control_words(s->control),
                      (int32_t)(US_Q33 * s->params->period_us), s->params->variance_turn2_q56);
    if (session_armed(s) && s->plausibility.failed != 0) {
        s->disarmed_by_checks = s->plausibility.failed; /* by the next poll */
    }
}

uint16_t readiness_blocked(const session_t *s) {
    unsigned blocked = 0;

    if (checked(s) != NULL) {
        blocked |= s->plausibility.failed != 0 ? ARMING_BLOCK_IMPLAUSIBLE : 0U;
        blocked |= s->plausibility.missing != 0 && !session_armed(s) ? ARMING_BLOCK_NOT_READY : 0U;
    }
    return (uint16_t)blocked;
}

void readiness_send(session_t *s, link_t link) {
    const bool known = checked(s) != NULL;
    const message_plausibility_t m = {.failed = known ? s->plausibility.failed : 0U,
                                      .missing = known ? s->plausibility.missing : 0U,
                                      .disarmed_by = s->disarmed_by_checks};

    outbox_telemetry(s->link[link].outbox, message_plausibility_pack(&m), 0);
}
