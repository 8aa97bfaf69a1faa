#include "execution.h"
#include "arming_reasons.h"
#include "generated/messages.h"
#include "news.h"
#include "nonce.h"
#include "pilot.h"
#include "run_requests.h"

/* The ACK of ARM repeats upper bits of the nonce as the host sent it: on a bus each host knows its own ACK by
 * them. */
#define ARM_ECHO_MASK 0xFFFF0000U

void execution_challenge(session_t *s, const request_t *q) {
    const message_challenge_t m = message_challenge_unpack(q->frame);
    const message_nonce_t nonce = {
        .verb = m.verb, .nonce = nonce_issue(&s->nonce[q->link], &s->random, m.verb, m.asker, q->now_us)};

    routing_reply(&s->routing, q, message_nonce_pack(&nonce), 0);
}

/* Executes a verb other than ARM; returns 0 or the reason of the NACK. */
static uint16_t execute(session_t *s, const request_t *q, uint16_t verb) {
    uint16_t reason = 0;

    if (verb == MESSAGE_EXECUTE_VERB_DISARM) {
        arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
        return 0;
    }
    session_end_alone(s, q->now_us);
    if (s->run.mode != RUN_IDLE || session_armed(s)) {
        return MESSAGE_NACK_REASON_BUSY;
    }
    switch (verb) {
    case MESSAGE_EXECUTE_VERB_SAVE:
        session_keep_learned(s);
        return staging_save(&s->staging, s->params);
    case MESSAGE_EXECUTE_VERB_LOAD:
        reason = staging_load(&s->staging, s->params);
        break;
    case MESSAGE_EXECUTE_VERB_DEFAULTS:
        staging_defaults(&s->staging);
        break;
    case MESSAGE_EXECUTE_VERB_BOOTLOADER:
        /* The ROM bootloader of this part listens on PA9 and PA10 only, which drive the bridge in its pin
         * set.
         */
        if (q->link != LINK_UART || s->board->pins == BOARD_PINS_BRIDGE) {
            return MESSAGE_NACK_REASON_UNSUPPORTED;
        }
        session_ask_bootloader(s, q->now_us);
        return 0;
    default:
        return MESSAGE_NACK_REASON_UNSUPPORTED;
    }
    session_apply_staged(s);
    return reason;
}

static void arm(session_t *s, const request_t *q) {
    const uint32_t echo = message_execute_unpack(q->frame).nonce & ARM_ECHO_MASK;
    uint16_t blocked;

    if (session_arm(s, q, &blocked)) {
        routing_ack(&s->routing, q, s->arming.number | echo);
    } else {
        session_send_readiness(s, q->link); /* before the NACK, so that the host knows what is missing */
        if ((blocked & ARMING_BLOCK_PARAMETER) !=
            0) { /* names the parameter: this reason does not pass by itself */
            routing_nack(&s->routing, q, MESSAGE_NACK_REASON_UNSAFE_PARAMETER, s->staging.unsafe);
        } else {
            routing_nack(&s->routing, q, MESSAGE_NACK_REASON_BLOCKED, blocked);
        }
    }
}

void execution_execute(session_t *s, const request_t *q) {
    const message_execute_t m = message_execute_unpack(q->frame);

    if (!nonce_answer(&s->nonce[q->link], m.verb, m.nonce, q->now_us)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.verb == MESSAGE_EXECUTE_VERB_ARM && run_requests_refused_in_flight(s, q)) {
        return;
    } else if (m.verb == MESSAGE_EXECUTE_VERB_ARM) {
        arm(s, q);
    } else {
        const uint16_t reason = execute(s, q, m.verb);

        if (reason == 0) {
            routing_ack(&s->routing, q, m.verb);
        } else {
            routing_nack(&s->routing, q, reason, m.verb);
        }
    }
}
