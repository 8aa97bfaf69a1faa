#include "requests.h"
#include "arming_reasons.h"
#include "news.h"
#include "permissions.h"
#include "stepping.h"
#include "switches.h"

#define ALL_PARAMETERS 0xFFFFU
#define RUN_TAG_SHIFT  16U /* in the ACK of RUN_BEGIN, above its run */
/* The ACKs of RUN_BEGIN and of ARM repeat upper bits of the nonce as the host sent it: on a bus each host
 * knows its own ACK by them. */
#define RUN_ECHO_MASK 0xFFF00000U
#define ARM_ECHO_MASK 0xFFFF0000U
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

/* ---- parameters ---- */

static void on_param_get(session_t *s, const request_t *q) {
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

static void on_param_commit(session_t *s, const request_t *q) {
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

/* ---- commands that answer a nonce ---- */

static void on_challenge(session_t *s, const request_t *q) {
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

/* While a pilot holds the board armed, of all requests EXECUTE DISARM alone stops it. ARM would hold the
 * rotors at neutral, and then wait for keep-alives. */
static bool refused_in_flight(session_t *s, const request_t *q) {
    if (session_piloted(s)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_ARMED, s->run.step);
        return true;
    }
    return false;
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

static void on_execute(session_t *s, const request_t *q) {
    const message_execute_t m = message_execute_unpack(q->frame);

    if (!nonce_answer(&s->nonce[q->link], m.verb, m.nonce, q->now_us)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.verb == MESSAGE_EXECUTE_VERB_ARM && refused_in_flight(s, q)) {
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

/* Samples and setpoints come from the owner's link unless its flags name the other link. */
static run_links_t links_of_run(link_t owner, unsigned flags) {
    const link_t other = owner == LINK_UART ? LINK_CAN : LINK_UART;

    return (run_links_t){
        .owner = owner,
        .samples = (flags & MESSAGE_RUN_BEGIN_SAMPLES_ELSEWHERE) != 0U ? other : owner,
        .setpoints = (flags & MESSAGE_RUN_BEGIN_SETPOINTS_ELSEWHERE) != 0U ? other : owner,
    };
}

static void on_run_begin(session_t *s, const request_t *q) {
    const message_run_begin_t m = message_run_begin_unpack(q->frame);
    const unsigned flags = e2e_flags(q->frame);

    if (!nonce_answer(&s->nonce[q->link], m.run, m.nonce, q->now_us)) {
        routing_nack(&s->routing, q, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (refused_in_flight(s, q)) {
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

/* ---- run, arming ---- */

static void on_run_end(session_t *s, const request_t *q) {
    if (refused_in_flight(s, q)) {
        return;
    }
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    run_end(&s->run);
    routing_ack(&s->routing, q, s->run.step);
}

static void on_disarm(session_t *s, const request_t *q) {
    if (refused_in_flight(s, q)) {
        return;
    }
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    routing_ack(&s->routing, q, 0);
}

static void on_keepalive(session_t *s, const request_t *q) {
    if (s->run.links.owner == q->link) { /* only the link that armed keeps the board armed */
        const message_keepalive_t m = message_keepalive_unpack(q->frame);

        (void)arming_keepalive(&s->arming, m.arming, m.value, q->now_us);
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
        on_keepalive(s, q);
        break;
    case MESSAGE_CLOSE_ID:
        on_close(s, q);
        break;
    case MESSAGE_DISARM_ID:
        on_disarm(s, q);
        break;
    case MESSAGE_CHALLENGE_ID:
        on_challenge(s, q);
        break;
    case MESSAGE_EXECUTE_ID:
        on_execute(s, q);
        break;
    case MESSAGE_RUN_BEGIN_ID:
        on_run_begin(s, q);
        break;
    case MESSAGE_RUN_END_ID:
        on_run_end(s, q);
        break;
    case MESSAGE_SELECT_ID:
        on_select(s, q);
        break;
    case MESSAGE_PARAM_GET_ID:
        on_param_get(s, q);
        break;
    case MESSAGE_PARAM_SET_ID:
        staging_on_set(&s->staging, &s->routing, q, s->params);
        break;
    case MESSAGE_PARAM_COMMIT_ID:
        on_param_commit(s, q);
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
