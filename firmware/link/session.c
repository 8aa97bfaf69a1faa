#include "session.h"
#include "messages.h"
#include "run.h"
#include <string.h>

#define TIME_EVERY_US   50000U
#define STATUS_EVERY_US 100000U
#define COUNTER_UNKNOWN 0xFFU
#define ALL_PARAMETERS  0xFFFFU

/* ---- what is, and whether it may be armed ---- */

bool session_armed(const session_t *s) {
    return s->arming.armed;
}

bool session_driving(const session_t *s) {
    return s->arming.driving;
}

bool session_live(const session_t *s) {
    return s->live;
}

session_mode_t session_mode(const session_t *s) {
    return s->mode;
}

uint32_t session_period_us(const session_t *s) {
    return s->params->period_us;
}

/* Control on a sample that is held is control of nothing: a few steps may be bridged, not more than
 * ARMING_SAFE_US. */
static bool samples_stale(const session_t *s) {
    return s->stale == UINT16_MAX || s->stale > ARMING_SAFE_US / s->params->period_us;
}

static uint16_t arming_blocked(const session_t *s) {
    unsigned blocked = 0;

    blocked |= s->greeted ? 0U : ARMING_BLOCK_HELLO;
    blocked |= s->mode == SESSION_IDLE ? ARMING_BLOCK_IDLE : 0U;
    blocked |= s->mode == SESSION_LOCKSTEP ? ARMING_BLOCK_LOCKSTEP : 0U;
    blocked |= (s->faults & SESSION_FAULTS_BLOCKING) != 0 ? ARMING_BLOCK_FAULT : 0U;
    blocked |= s->open && !s->read_only ? 0U : ARMING_BLOCK_CLOSED;
    blocked |= s->mode == SESSION_REALTIME && !s->live && samples_stale(s) ? ARMING_BLOCK_SAMPLES : 0U;
    blocked |= arming_handle(&s->arming);
    return (uint16_t)blocked;
}

void session_report_faults(session_t *s, uint32_t faults) {
    s->faults = faults;
}

static arming_actuator_t actuator(const session_t *s) {
    return (arming_actuator_t){.frame_us = s->params->esc_period_us,
                               .hold_us = 1000U * s->params->arm_hold_ms};
}

/* Closed while nothing runs, the switch starts the system in use on the board's own sensors; that run ends
 * when it is disarmed, so that the next closing begins with a fresh state. */
void session_report_switch(session_t *s, bool closed, uint32_t now_us) {
    if (arming_switch(&s->arming, closed, now_us) && s->mode == SESSION_IDLE) {
        run_begin(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
        s->stand_alone = true;
    }
    arming_try_switch(&s->arming, arming_blocked(s), actuator(s), now_us);
    if (s->stand_alone && !s->arming.armed && !s->arming.switch_trying) {
        s->stand_alone = false;
        s->mode = SESSION_IDLE;
        s->live = false;
    }
}

/* ---- replies ---- */

static void reply_ack(session_t *s, const can_frame_t *request, uint32_t detail) {
    const message_ack_t m = {.request = request->id, .detail = detail};

    outbox_reply(&s->outbox, message_ack_pack(&m), e2e_counter(request));
}

static void reply_nack(session_t *s, const can_frame_t *request, uint16_t reason, uint16_t detail) {
    const message_nack_t m = {.request = request->id, .reason = reason, .detail = detail};

    outbox_reply(&s->outbox, message_nack_pack(&m), e2e_counter(request));
}

/* ---- connect ---- */

static uint32_t identity_value(const session_t *s, uint16_t item, uint32_t now_us) {
    const board_identity_t *b = s->board;

    switch (item) {
    case MESSAGE_IDENTITY_ITEM_PROTOCOL_VERSION:
        return MESSAGES_PROTOCOL_VERSION;
    case MESSAGE_IDENTITY_ITEM_DBC_HASH:
        return MESSAGES_DBC_HASH;
    case MESSAGE_IDENTITY_ITEM_GIT_HASH_0:
        return b->git_hash[0];
    case MESSAGE_IDENTITY_ITEM_GIT_HASH_1:
        return b->git_hash[1];
    case MESSAGE_IDENTITY_ITEM_GIT_DIRTY:
        return b->git_dirty;
    case MESSAGE_IDENTITY_ITEM_PART_ID:
        return b->part_id;
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_0:
        return b->unique_id[0];
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_1:
        return b->unique_id[1];
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_2:
        return b->unique_id[2];
    case MESSAGE_IDENTITY_ITEM_FLASH_KIB:
        return b->flash_kib;
    case MESSAGE_IDENTITY_ITEM_RAM_KIB:
        return b->ram_kib;
    case MESSAGE_IDENTITY_ITEM_PARAMETER_COUNT:
        return PARAMS_COUNT;
    case MESSAGE_IDENTITY_ITEM_PARAMETER_CRC:
        return params_crc32(s->params);
    case MESSAGE_IDENTITY_ITEM_RECORD_WORDS:
        return SESSION_RECORD_WORDS;
    case MESSAGE_IDENTITY_ITEM_RESET_CAUSE:
        return b->reset_cause;
    case MESSAGE_IDENTITY_ITEM_FAULTS:
        return s->faults;
    case MESSAGE_IDENTITY_ITEM_CRASH_PC:
        return b->crash_pc;
    case MESSAGE_IDENTITY_ITEM_CRASH_EXCEPTION:
        return b->crash_exception;
    default:
        return now_us; /* UPTIME_US, the last */
    }
}

#define IDENTITY_ITEMS (MESSAGE_IDENTITY_ITEM_UPTIME_US + 1U)

static void on_hello(session_t *s, const can_frame_t *f) {
    const message_hello_t m = message_hello_unpack(f);

    s->greeted = m.protocol_version == MESSAGES_PROTOCOL_VERSION && m.dbc_hash == MESSAGES_DBC_HASH;
    if (!s->greeted) {
        arming_disarm_host(&s->arming,
                           ARMING_BLOCK_HELLO); /* at once: a right one may follow by the next poll */
    }
    s->staged = *s->params;
    s->parameters_staged = false;
    s->identity = (session_reply_t){0, IDENTITY_ITEMS + 1U};
}

/* Long replies go on while there is room that others do not need. */
static void poll_long_replies(session_t *s, uint32_t now_us) {
    while (s->identity.next < s->identity.end && outbox_telemetry_fits(&s->outbox, 1)) {
        const uint16_t item = s->identity.next++;
        const bool end = item == IDENTITY_ITEMS;
        const message_identity_t m = {.item = end ? MESSAGE_IDENTITY_ITEM_END : item,
                                      .value = end ? IDENTITY_ITEMS : identity_value(s, item, now_us)};

        outbox_reply(&s->outbox, message_identity_pack(&m), 0);
    }
    while (s->dump.next < s->dump.end && outbox_telemetry_fits(&s->outbox, 1)) {
        const uint16_t index = s->dump.next++;
        const message_param_value_t m = {.index = index, .value = params_word(s->params, index)};

        outbox_reply(&s->outbox, message_param_value_pack(&m), 0);
    }
}

/* ---- parameters ---- */

static void on_param_get(session_t *s, const can_frame_t *f) {
    const message_param_get_t m = message_param_get_unpack(f);

    if (m.index == ALL_PARAMETERS) {
        s->dump = (session_reply_t){0, PARAMS_COUNT};
    } else if (m.index < PARAMS_COUNT) {
        const message_param_value_t value = {.index = m.index, .value = params_word(s->params, m.index)};

        outbox_reply(&s->outbox, message_param_value_pack(&value), 0);
    } else {
        reply_nack(s, f, MESSAGE_NACK_REASON_INDEX, m.index);
    }
}

static void on_param_set(session_t *s, const can_frame_t *f) {
    const message_param_set_t m = message_param_set_unpack(f);

    if (m.index >= PARAMS_COUNT) {
        reply_nack(s, f, MESSAGE_NACK_REASON_INDEX, m.index);
    } else if (!params_in_range(m.index, m.value)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_RANGE, m.index);
    } else {
        const message_param_staged_t staged = {.index = m.index, .value = m.value};

        params_set_word(&s->staged, m.index, m.value);
        s->parameters_staged = true;
        outbox_reply(&s->outbox, message_param_staged_pack(&staged), 0);
    }
}

/* What ties the core's words to the board's: between two pulses there is a gap. */
static bool pulses_fit(const params_t *p) {
    const int32_t frame_halfus = (int32_t)(2U * p->esc_period_us);

    return p->control.esc.max_halfus < frame_halfus && p->control.esc.neutral_halfus < frame_halfus;
}

static void on_param_commit(session_t *s, const can_frame_t *f) {
    const message_param_commit_t m = message_param_commit_unpack(f);

    if (s->mode != SESSION_IDLE) {
        reply_nack(s, f, MESSAGE_NACK_REASON_BUSY, 0);
    } else if (m.count != PARAMS_COUNT) {
        reply_nack(s, f, MESSAGE_NACK_REASON_COUNT, PARAMS_COUNT);
    } else if (m.crc != params_crc32(&s->staged)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_CRC, 0);
    } else if (!control_params_valid(&s->staged.control) || !pulses_fit(&s->staged)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_PARAMETERS, 0);
    } else {
        *s->params = s->staged;
        s->parameters_staged = false;
        reply_ack(s, f, m.crc);
    }
}

/* ---- commands that answer a nonce ---- */

static void on_challenge(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_challenge_t m = message_challenge_unpack(f);
    const message_nonce_t nonce = {.verb = m.verb, .nonce = arming_challenge(&s->arming, m.verb, now_us)};

    outbox_reply(&s->outbox, message_nonce_pack(&nonce), 0);
}

static void on_execute(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_execute_t m = message_execute_unpack(f);

    if (!arming_answer(&s->arming, m.verb, m.nonce, now_us)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.verb != MESSAGE_EXECUTE_VERB_ARM) {
        reply_nack(s, f, MESSAGE_NACK_REASON_UNSUPPORTED, m.verb);
    } else if (!arming_arm(&s->arming, arming_blocked(s), m.nonce, actuator(s), now_us)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_BLOCKED, arming_blocked(s));
    } else {
        reply_ack(s, f, m.verb);
    }
}

static void on_run_begin(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_run_begin_t m = message_run_begin_unpack(f);

    if (!arming_answer(&s->arming, m.run, m.nonce, now_us)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.run < MESSAGE_RUN_BEGIN_RUN_LOCKSTEP || m.run > MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE) {
        reply_nack(s, f, MESSAGE_NACK_REASON_UNSUPPORTED, m.run);
    } else {
        arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
        s->stand_alone = false;
        run_begin(s, m.run);
        reply_ack(s, f, m.run);
    }
}

static void on_run_end(session_t *s, const can_frame_t *f) {
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    s->stand_alone = false;
    s->mode = SESSION_IDLE;
    s->live = false;
    reply_ack(s, f, s->step);
}

static void on_select(session_t *s, const can_frame_t *f) {
    const message_select_t m = message_select_unpack(f);

    if (m.bank > SESSION_WORD_BANKS) {
        reply_nack(s, f, MESSAGE_NACK_REASON_INDEX, m.bank);
    } else if (!run_select(s, m.bank, m.mask)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_ROOM, m.bank);
    } else {
        reply_ack(s, f, m.mask);
    }
}

static void on_disarm(session_t *s, const can_frame_t *f) {
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    reply_ack(s, f, 0);
}

/* ---- receive ---- */

/* The counter tells what went missing; SAMPLE and SETPOINT are numbered by their step and looked at by run.c.
 */
static void note_counter(session_t *s, const can_frame_t *f) {
    uint8_t *last = &s->counter[OUTBOX_SLOT(f->id)];

    if (*last != COUNTER_UNKNOWN) {
        s->lost = (uint16_t)(s->lost + ((e2e_counter(f) - *last - 1U) & E2E_COUNTER_MASK));
    }
    *last = e2e_counter(f);
}

void session_take_frame(session_t *s, const can_frame_t *f, uint32_t now_us) {
    switch (f->id) {
    case MESSAGE_SAMPLE_A_ID:
        run_on_sample_a(s, f);
        return;
    case MESSAGE_SAMPLE_B_ID:
        run_on_sample_b(s, f);
        return;
    case MESSAGE_SETPOINT_ID:
        run_on_setpoint(s, f);
        return;
    case MESSAGE_HELLO_ID:
        memset(s->counter, COUNTER_UNKNOWN, sizeof s->counter);
        on_hello(s, f);
        break;
    case MESSAGE_KEEPALIVE_ID:
        (void)arming_keepalive(&s->arming, message_keepalive_unpack(f).token, now_us);
        break;
    case MESSAGE_DISARM_ID:
        on_disarm(s, f);
        break;
    case MESSAGE_CHALLENGE_ID:
        on_challenge(s, f, now_us);
        break;
    case MESSAGE_EXECUTE_ID:
        on_execute(s, f, now_us);
        break;
    case MESSAGE_RUN_BEGIN_ID:
        on_run_begin(s, f, now_us);
        break;
    case MESSAGE_RUN_END_ID:
        on_run_end(s, f);
        break;
    case MESSAGE_SELECT_ID:
        on_select(s, f);
        break;
    case MESSAGE_PARAM_GET_ID:
        on_param_get(s, f);
        break;
    case MESSAGE_PARAM_SET_ID:
        on_param_set(s, f);
        break;
    case MESSAGE_PARAM_COMMIT_ID:
        on_param_commit(s, f);
        break;
    default:
        return; /* other nodes' frames */
    }
    note_counter(s, f);
}

bool session_accepts(session_t *s, const can_frame_t *f) {
    const bool good = e2e_check(f) && s->open && !s->read_only;

    s->rejected = (uint16_t)(s->rejected + !good);
    return good;
}

/* ---- transmit ---- */

size_t session_transmit(session_t *s, uint8_t *out, size_t room) {
    return outbox_take(&s->outbox, out, room);
}

static uint8_t status_flags(const session_t *s) {
    unsigned flags = 0;

    flags |= s->arming.armed ? MESSAGE_STATUS_ARMED : 0U;
    flags |= s->live ? MESSAGE_STATUS_LIVE : 0U;
    flags |= s->parameters_staged ? MESSAGE_STATUS_STAGED : 0U;
    flags |= s->read_only ? MESSAGE_STATUS_READ_ONLY : 0U;
    return (uint8_t)flags;
}

static void send_status(session_t *s) {
    const message_status_t status = {
        .mode = (uint16_t)s->mode, .blocked = arming_blocked(s), .faults = (uint16_t)(s->faults & 0xFFFFU)};
    const message_counters_t counters = {
        .rejected = s->rejected, .lost = s->lost, .dropped = s->outbox.dropped};
    const message_events_t events = {
        .saturated = s->saturated, .starved = s->starved, .disarm_cause = s->arming.cause};

    outbox_telemetry(&s->outbox, message_status_pack(&status), status_flags(s));
    outbox_telemetry(&s->outbox, message_counters_pack(&counters), 0);
    outbox_telemetry(&s->outbox, message_events_pack(&events), 0);
}

void session_poll(session_t *s, uint32_t now_us) {
    arming_poll(&s->arming, arming_blocked(s), now_us);
    poll_long_replies(s, now_us);
    if (!s->open) {
        return;
    }
    if (now_us - s->time_us >= TIME_EVERY_US) {
        const message_time_t m = {.step = s->step, .time = now_us};

        s->time_us = now_us;
        outbox_telemetry(&s->outbox, message_time_pack(&m), 0);
    }
    if (now_us - s->status_us >= STATUS_EVERY_US) {
        s->status_us = now_us;
        send_status(s);
    }
}

void session_init(session_t *s, const board_identity_t *board, control_t *control, params_t *params) {
    memset(s, 0, sizeof *s);
    s->board = board;
    s->control = control;
    s->params = params;
    s->staged = *params;
    slcan_rx_init(&s->rx);
    outbox_init(&s->outbox);
    arming_init(&s->arming, board->unique_id[0] ^ board->unique_id[1] ^ board->unique_id[2]);
    memset(s->counter, COUNTER_UNKNOWN, sizeof s->counter);
    (void)run_select(s, 0, 0);
    control_init(control, &params->control);
}
