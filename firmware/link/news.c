#include "news.h"
#include "arming_reasons.h"
#include "session_battery.h"

void session_send_readiness(session_t *s, link_t link) {
    const message_plausibility_t m = readiness_message(&s->readiness, session_checked(s));

    outbox_telemetry(s->routing.link[link].outbox, message_plausibility_pack(&m), 0);
}

/* Sends the status to one open link: the frames that changed, or all of them when the period is over. */
static void send_status(session_t *s, link_t link, bool all, uint32_t now_us) {
    const routing_link_t *const l = &s->routing.link[link];
    message_status_t status = {.mode = (uint16_t)s->run.mode};
    const message_events_t events = {
        .saturated = s->run.saturated, .starved = s->run.starved, .disarm_cause = s->arming.cause};
    const message_plausibility_t plausibility = readiness_message(&s->readiness, session_checked(s));
    const status_round_t round = {.link = l,
                                  .news = &s->buffers->news[link],
                                  .now_us = now_us,
                                  .all = all,
                                  .counts = s->run.mode == RUN_REALTIME};
    unsigned flags = 0;

    flags |= arming_armed(&s->arming) ? MESSAGE_STATUS_ARMED : 0U;
    flags |= s->run.live ? MESSAGE_STATUS_LIVE : 0U;
    flags |= s->staging.pending ? MESSAGE_STATUS_STAGED : 0U;
    flags |= l->read_only ? MESSAGE_STATUS_READ_ONLY : 0U;
    if (status_goes(&s->status, &round, (uint8_t)flags)) {
        status.blocked = session_arming_blocked(s, link);
    }
    status_send(&s->status, &round, &status, (uint8_t)flags, &events, &plausibility);
    if (all) {
        session_send_battery(s, link);
    }
}

/* In lockstep nothing can be armed, and the host compares every step: a change waits for the period. */
void session_send_news(session_t *s, uint32_t now_us) {
    const bool all = status_due(&s->status, now_us);

    if (!all && s->run.mode == RUN_LOCKSTEP) {
        return;
    }
    for (unsigned i = 0; i < LINKS; i++) {
        if (s->routing.link[i].open) {
            send_status(s, (link_t)i, all, now_us);
        }
    }
}

void session_issue_keepalive(session_t *s, uint32_t now_us) {
    const message_keepalive_value_t m = {.arming = s->arming.number,
                                         .value = arming_issue(&s->arming, &s->random, now_us)};

    if (m.value != 0U) {
        outbox_urgent(s->routing.link[s->run.links.owner].outbox, message_keepalive_value_pack(&m), 0);
    }
}

void session_send_long_replies(session_t *s, uint32_t now_us) {
    const identity_t identity = {.board = s->board,
                                 .params = s->params,
                                 .staging = &s->staging,
                                 .faults = s->status.faults,
                                 .now_us = now_us};

    for (unsigned i = 0; i < LINKS; i++) {
        long_replies_poll(&s->long_replies[i], s->routing.link[i].outbox, &identity);
    }
}

void session_send_time(session_t *s, uint32_t now_us) {
    if (status_time_due(&s->status, now_us)) {
        const message_time_t m = {.step = s->run.step, .time = now_us};

        routing_telemetry(&s->routing, message_time_pack(&m), s->run.mode != RUN_IDLE ? s->run.tag : 0U);
    }
}
