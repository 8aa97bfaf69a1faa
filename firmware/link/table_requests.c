#include "table_requests.h"
#include "arming_reasons.h"
#include "generated/messages.h"
#include "long_replies.h"
#include "pilot.h"
#include "staging.h"

#define ALL_PARAMETERS 0xFFFFU

void table_requests_get(session_t *s, const request_t *q) {
    if (message_param_get_unpack(q->frame).index == ALL_PARAMETERS) {
        long_replies_ask_table(&s->long_replies[q->link]);
    } else {
        staging_on_get(&s->routing, q, s->params);
    }
}

/* Why the staged table may not come into use now; 0: it may. Without a run it always may. A run in real time
 * takes live parameters; while armed from its owner alone, and no more than a factor of two from what it was
 * at arming. */
static uint16_t run_forbids_staged(const session_t *s, const request_t *q, uint16_t *detail) {
    const bool armed = session_armed(s);

    if (s->run.mode == RUN_IDLE) {
        return 0;
    }
    if (armed && s->run.links.owner != q->link) {
        return MESSAGE_NACK_REASON_OWNER;
    }
    if (session_piloted(s) && staging_unsafe(s->staging.table) != PARAMS_COUNT) { /* it would disarm */
        *detail = staging_unsafe(s->staging.table);
        return MESSAGE_NACK_REASON_UNSAFE_PARAMETER;
    }
    const uint16_t word = params_fixed_change(s->params, s->staging.table, armed ? &s->staging.gains : NULL);
    if (s->run.mode == RUN_REALTIME && word == PARAMS_COUNT) {
        return 0;
    }
    *detail = armed ? word : 0U;
    return armed ? MESSAGE_NACK_REASON_ARMED : MESSAGE_NACK_REASON_BUSY;
}

void table_requests_commit(session_t *s, const request_t *q) {
    const uint32_t crc = message_param_commit_unpack(q->frame).crc;
    uint16_t detail = 0;

    session_end_alone(s, q->now_us);
    uint16_t reason = run_forbids_staged(s, q, &detail);

    if (reason == 0) {
        reason = staging_check_commit(&s->staging, q->frame, &detail);
    }
    if (reason != 0) {
        routing_nack(&s->routing, q, reason, detail);
    } else {
        session_apply_staged(s);
        session_report_parameters(s, crc);
        staging_committed(&s->staging);
        routing_ack(&s->routing, q, crc);
    }
}
