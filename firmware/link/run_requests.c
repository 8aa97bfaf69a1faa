#include "run_requests.h"
#include "arming_reasons.h"
#include "generated/messages.h"
#include "nonce.h"
#include "stepping.h"

#define RUN_TAG_SHIFT 16U /* in the ACK of RUN_BEGIN, above its run */
/* The ACK of RUN_BEGIN repeats upper bits of the nonce as the host sent it: on a bus each host knows its own
 * ACK by them. */
#define RUN_ECHO_MASK 0xFFF00000U

bool run_requests_refused_in_flight(session_t *s, const request_t *q) {
    if (session_piloted(s)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_ARMED, s->run.step);
        return true;
    }
    return false;
}

/* Samples and setpoints come from the owner's link unless its flags name the other link. */
static run_links_t links_of_run(link_t owner, unsigned flags) {
    const link_t other = owner == LINK_UART ? LINK_CAN : LINK_UART;

    return (run_links_t){
        .owner = owner,
        .samples = (flags & MESSAGE_RUN_BEGIN_SAMPLES_ELSEWHERE) != 0U ? other : owner,
        .setpoints = (flags & MESSAGE_RUN_BEGIN_SETPOINTS_ELSEWHERE) != 0U ? other : owner,
    };
}

void run_requests_begin(session_t *s, const request_t *q) {
    const message_run_begin_t m = message_run_begin_unpack(q->frame);
    const unsigned flags = e2e_flags(q->frame);

    if (!nonce_answer(&s->nonce[q->link], m.run, m.nonce, q->now_us)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (run_requests_refused_in_flight(s, q)) {
        return;
    } else if (m.run < MESSAGE_RUN_BEGIN_RUN_LOCKSTEP || m.run > MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE ||
               ((flags & MESSAGE_RUN_BEGIN_SETPOINTS_ELSEWHERE) != 0U && s->system->owner_alone) ||
               (m.run == MESSAGE_RUN_BEGIN_RUN_LOCKSTEP && flags != 0U)) { /* one link paces lockstep */
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_UNSUPPORTED, m.run);
    } else {
        arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
        session_begin_run(s, m.run, links_of_run(q->link, flags));
        routing_ack(&s->routing, q,
                    m.run | (uint32_t)s->run.tag << RUN_TAG_SHIFT | (m.nonce & RUN_ECHO_MASK));
    }
}

void run_requests_end(session_t *s, const request_t *q) {
    if (run_requests_refused_in_flight(s, q)) {
        return;
    }
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    run_end(&s->run);
    routing_ack(&s->routing, q, s->run.step);
}

void run_requests_disarm(session_t *s, const request_t *q) {
    if (run_requests_refused_in_flight(s, q)) {
        return;
    }
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    routing_ack(&s->routing, q, 0);
}

void run_requests_keepalive(session_t *s, const request_t *q) {
    if (s->run.links.owner == q->link) { /* only the link that armed keeps the board armed */
        const message_keepalive_t m = message_keepalive_unpack(q->frame);

        (void)arming_keepalive(&s->arming, m.arming, m.value, q->now_us);
    }
}
