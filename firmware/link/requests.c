#include "requests.h"
#include "arming_reasons.h"
#include "execution.h"
#include "permissions.h"
#include "run_requests.h"
#include "stepping.h"
#include "table_requests.h"

/* Outbox entries that one CAN frame may need: two replies (one may be a pending SETPOINT_USED), and the
 * urgent frames. */
#define FRAME_REPLIES (2U + OUTBOX_URGENT)

/* ---- link ---- */

static void on_hello(session_t *s, const request_t *q) {
    const message_hello_t m = message_hello_unpack(q->frame);
    const bool good = m.protocol_version == MESSAGES_PROTOCOL_VERSION && m.dbc_hash == MESSAGES_DBC_HASH;

    routing_greet(&s->routing, q->link, good);
    if (!good) {
        /* At once: a valid HELLO before the next poll would hide this one. */
        session_link_lost(s, q->link, ARMING_BLOCK_HELLO);
    }
    staging_discard(&s->staging, q->link, s->params);
    long_replies_ask_identity(&s->long_replies[q->link]);
}

static void on_close(session_t *s, const request_t *q) {
    routing_ack(&s->routing, q, 0);
    routing_open(&s->routing, q->link, false, false);
    session_link_lost(s, q->link, ARMING_BLOCK_CLOSED);
}

static void on_select(session_t *s, const request_t *q) {
    const message_select_t m = message_select_unpack(q->frame);

    if (m.bank > TELEMETRY_WORD_BANKS) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_INDEX, m.bank);
    } else {
        telemetry_select(&s->telemetry, &s->params->control, m.bank, m.mask);
        routing_ack(&s->routing, q, m.mask);
    }
}

static void on_sample_a(session_t *s, const request_t *q) {
    uint16_t step;

    if (run_on_sample_a(&s->run, &s->routing, q, s->params, &step)) {
        session_repeat_step(s, q, step);
    }
}

/* ---- receive ---- */

/* True for a frame that the SAMPLE_A or the SETPOINT after it completes. */
static bool is_part(uint16_t id) {
    return id == MESSAGE_SAMPLE_B_ID || permissions_more_inputs(id);
}

/* Frames that carry the inputs for which SAMPLE_A, SAMPLE_B and SETPOINT have no room. */
static void on_more_inputs(session_t *s, const request_t *q) {
#if CONTROL_COUNTS_MAX > 6U
    if (q->frame->id >= MESSAGE_SAMPLE_C_ID && q->frame->id < MESSAGE_SAMPLE_C_ID + RUN_MORE_FRAMES - 1U) {
        run_on_more_counts(&s->run, q, q->frame->id - MESSAGE_SAMPLE_C_ID + 1U);
    }
#endif
#if CONTROL_COMMANDS_MAX > 0U
    if (q->frame->id >= MESSAGE_COMMAND_A_ID && q->frame->id < MESSAGE_COMMAND_A_ID + COMMAND_FRAMES) {
        run_on_command(&s->run, q, q->frame->id - MESSAGE_COMMAND_A_ID);
    }
#endif
    (void)s, (void)q;
}

/* SAMPLE and SETPOINT carry their step number, which run.c checks; all other frames carry a counter. */
void requests_handle(session_t *s, const request_t *q) {
    random_stir(&s->random, q->now_us);
    if (!s->routing.link[q->link].greeted && permissions_need_greeting(q->frame)) {
        if (!is_part(q->frame->id)) { /* the SAMPLE_A or SETPOINT that follows gets the NACK */
            routing_nack(&s->routing, q, MESSAGE_NACK_REASON_GREETING, 0);
        }
        return;
    }
    switch (q->frame->id) {
    case MESSAGE_SAMPLE_A_ID:
        on_sample_a(s, q);
        return;
    case MESSAGE_SAMPLE_B_ID:
        run_on_more_counts(&s->run, q, 0);
        return;
    case MESSAGE_SETPOINT_ID:
        run_on_setpoint(&s->run, &s->routing, q, s->params->period_us);
        return;
    case MESSAGE_HELLO_ID:
        on_hello(s, q);
        break;
    case MESSAGE_KEEPALIVE_ID:
        run_requests_keepalive(s, q);
        break;
    case MESSAGE_CLOSE_ID:
        on_close(s, q);
        break;
    case MESSAGE_DISARM_ID:
        run_requests_disarm(s, q);
        break;
    case MESSAGE_CHALLENGE_ID:
        execution_challenge(s, q);
        break;
    case MESSAGE_EXECUTE_ID:
        execution_execute(s, q);
        break;
    case MESSAGE_RUN_BEGIN_ID:
        run_requests_begin(s, q);
        break;
    case MESSAGE_RUN_END_ID:
        run_requests_end(s, q);
        break;
    case MESSAGE_SELECT_ID:
        on_select(s, q);
        break;
    case MESSAGE_PARAM_GET_ID:
        table_requests_get(s, q);
        break;
    case MESSAGE_PARAM_SET_ID:
        staging_on_set(&s->staging, &s->routing, q, s->params);
        break;
    case MESSAGE_PARAM_COMMIT_ID:
        table_requests_commit(s, q);
        break;
    default:
        on_more_inputs(s, q);
        return; /* other nodes' frames, too */
    }
    routing_note_counter(&s->routing, q);
}

size_t requests_room(const session_t *s) {
    return commands_room(&s->routing);
}

static void receive_text_frame(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const request_t q = {.frame = f, .link = LINK_UART, .now_us = now_us};
    const bool accepted = routing_accept(&s->routing, &q);

    commands_answer_frame(&s->routing, accepted);
    if (accepted) {
        requests_handle(s, &q);
    }
}

void requests_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us) {
    const uint8_t *at = bytes;

    for (;;) {
        can_frame_t frame;

        switch (commands_push(&s->buffers->commands, &s->routing, &at, bytes + count, &frame)) {
        case COMMANDS_FRAME:
            receive_text_frame(s, &frame, now_us);
            break;
        case COMMANDS_CLOSED:
            session_link_lost(s, LINK_UART, ARMING_BLOCK_CLOSED);
            break;
        case COMMANDS_NOTHING:
            return;
        }
    }
}

bool requests_frame_room(const session_t *s) {
    return outbox_room(s->routing.link[LINK_CAN].outbox) >= FRAME_REPLIES;
}

void requests_receive_frame(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const request_t q = {.frame = f, .link = LINK_CAN, .now_us = now_us};

    if (routing_accept(&s->routing, &q)) {
        requests_handle(s, &q);
    }
}
