#include "session.h"
#include "app/board_guard.h"
#include "identity.h"
#include "links.h"
#include "messages.h"
#include "permissions.h"
#include "readiness.h"
#include "requests.h"
#include "run.h"
#include "setpoint.h"
#include "telemetry.h"
#include <string.h>

#define TIME_EVERY_US    50000U
#define STATUS_EVERY_US  100000U
#define LONG_STARVED_US  2000U /* the longest table takes 0.2 s then, less than a host waits for a frame */
#define ALL_PARAMETERS   0xFFFFU
#define RUN_TAG_SHIFT    16U    /* in the ACK of RUN_BEGIN, above its run */
#define STEPS_MISSING    3U     /* armed, a step is overdue after so many periods, */
#define STEPS_MISSING_US 20000U /* and so much */
/* What a frame is answered by, a SETPOINT_USED that is still owed, and urgent frames. */
#define FRAME_REPLIES (2U + OUTBOX_URGENT)

/* ---- what is, and whether it may be armed ---- */

bool session_armed(const session_t *s) {
    return arming_armed(&s->arming);
}

bool session_driving(const session_t *s) {
    return arming_driving(&s->arming);
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

/* Whether what the system drives is on the pins that the board started with. */
static bool moves_something(const session_t *s) {
    if ((s->faults & BOARD_FAULT_STRAP) != 0) {
        return false;
    }
    switch (s->params->control.system) {
    case CONTROL_QUAD:
        return s->board->pins == BOARD_PINS_STANDARD;
    case CONTROL_BALANCER:
        return s->board->pins == BOARD_PINS_BRIDGE;
    default:
        return false;
    }
}

/* As seen from one link; LINK_NONE: without a host. */
static uint16_t arming_blocked(const session_t *s, link_t link) {
    const session_link_t *const l = link != LINK_NONE ? &s->link[link] : NULL;
    unsigned blocked = 0;

    blocked |= l != NULL && l->greeted ? 0U : ARMING_BLOCK_HELLO;
    blocked |= s->mode == SESSION_IDLE ? ARMING_BLOCK_IDLE : 0U;
    blocked |= s->mode == SESSION_LOCKSTEP ? ARMING_BLOCK_LOCKSTEP : 0U;
    blocked |= (s->faults & SESSION_FAULTS_BLOCKING) != 0 ? ARMING_BLOCK_FAULT : 0U;
    blocked |= l != NULL && l->open && !l->read_only ? 0U : ARMING_BLOCK_CLOSED;
    blocked |= s->mode != SESSION_IDLE && s->run_owner != link ? ARMING_BLOCK_OWNER : 0U;
    blocked |= s->mode == SESSION_REALTIME && !s->live && samples_stale(s) ? ARMING_BLOCK_SAMPLES : 0U;
    blocked |= moves_something(s) ? 0U : ARMING_BLOCK_PINS;
    blocked |= arming_handle(&s->arming);
    blocked |= readiness_blocked(s);
    return (uint16_t)blocked;
}

void session_report_faults(session_t *s, uint32_t faults) {
    s->faults = faults | requests_faults(s);
}

void session_report_can(session_t *s, const board_can_health_t *health) {
    s->can = health;
}

uint32_t session_can_kbit(const session_t *s) {
    return s->can_kbit;
}

void session_report_sensors(session_t *s, const board_health_t *health) {
    s->health = *health;
}

static arming_actuator_t actuator(const session_t *s) {
    return (arming_actuator_t){.frame_us = s->params->esc_period_us,
                               .hold_us = 1000U * s->params->arm_hold_ms};
}

/* Closed while nothing runs, the switch starts the system in use on the board's own sensors; that run ends
 * when it is disarmed, so that the next closing begins with a fresh state. */
void session_report_switch(session_t *s, bool closed, uint32_t now_us) {
    if (arming_switch(&s->arming, closed, now_us) && s->mode == SESSION_IDLE) {
        run_begin(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE, (run_links_t){LINK_NONE, LINK_NONE, LINK_NONE});
        s->stand_alone = true;
    }
    if (s->arming.switch_trying) {
        arming_try_switch(&s->arming, arming_blocked(s, s->run_owner), actuator(s), now_us);
    }
    if (s->stand_alone && !arming_armed(&s->arming) && !s->arming.switch_trying) {
        s->stand_alone = false;
        s->mode = SESSION_IDLE;
        s->live = false;
    }
}

/* ---- replies ---- */

static void reply_ack(session_t *s, const can_frame_t *request, uint32_t detail) {
    const message_ack_t m = {.request = request->id, .detail = detail};

    links_reply(s, message_ack_pack(&m), e2e_counter(request));
}

static void reply_nack(session_t *s, const can_frame_t *request, uint16_t reason, uint16_t detail) {
    const message_nack_t m = {.request = request->id, .reason = reason, .detail = detail};

    links_reply(s, message_nack_pack(&m), e2e_counter(request));
}

/* ---- connect ---- */

static void on_hello(session_t *s, const can_frame_t *f) {
    const message_hello_t m = message_hello_unpack(f);
    session_link_t *const l = &s->link[s->asked];

    links_forget_counters(l);
    l->greeted = m.protocol_version == MESSAGES_PROTOCOL_VERSION && m.dbc_hash == MESSAGES_DBC_HASH;
    if (!l->greeted && s->run_owner == s->asked) {
        /* At once: a right one may follow by the next poll. */
        arming_disarm_host(&s->arming, ARMING_BLOCK_HELLO);
    }
    if (s->staged_by == s->asked) {
        s->buffers->staged = *s->params;
        s->parameters_staged = false;
    }
    l->identity = (session_reply_t){0, IDENTITY_ITEMS + 1U};
}

/* Whether a long reply may go on: there is room that telemetry does not need, or telemetry has left it none
 * for LONG_STARVED_US, and it takes one entry as any reply does. */
static bool long_reply_fits(session_link_t *l, uint32_t now_us) {
    const bool fits = outbox_long_fits(l->outbox) ||
                      (now_us - l->long_us >= LONG_STARVED_US && outbox_telemetry_fits(l->outbox, 1));

    l->long_us = fits ? now_us : l->long_us;
    return fits;
}

static void poll_long_replies(session_t *s, session_link_t *l, uint32_t now_us) {
    while (l->identity.next < l->identity.end && long_reply_fits(l, now_us)) {
        const uint16_t item = l->identity.next++;
        const bool end = item == IDENTITY_ITEMS;
        const message_identity_t m = {.item = end ? MESSAGE_IDENTITY_ITEM_END : item,
                                      .value = end ? IDENTITY_ITEMS : identity_value(s, item, now_us)};

        outbox_reply(l->outbox, message_identity_pack(&m), 0);
    }
    while (l->dump.next < l->dump.end && long_reply_fits(l, now_us)) {
        const uint16_t index = l->dump.next++;
        const message_param_value_t m = {.index = index, .value = params_word(s->params, index)};

        outbox_reply(l->outbox, message_param_value_pack(&m), 0);
    }
}

/* ---- parameters ---- */

static void on_param_get(session_t *s, const can_frame_t *f) {
    const message_param_get_t m = message_param_get_unpack(f);

    if (m.index == ALL_PARAMETERS) {
        s->link[s->asked].dump = (session_reply_t){0, PARAMS_COUNT};
    } else if (m.index < PARAMS_COUNT) {
        const message_param_value_t value = {.index = m.index, .value = params_word(s->params, m.index)};

        links_reply(s, message_param_value_pack(&value), 0);
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

        if (!s->parameters_staged || s->staged_by != s->asked) { /* one host's table, or the other's */
            s->buffers->staged = *s->params;
            s->staged_by = s->asked;
        }
        params_set_word(&s->buffers->staged, m.index, m.value);
        s->parameters_staged = true;
        links_reply(s, message_param_staged_pack(&staged), 0);
    }
}

void session_use_staged(session_t *s) {
    if (s->buffers->staged.control.system != s->params->control.system) {
        telemetry_select_nothing(s); /* another record */
    }
    *s->params = s->buffers->staged;
    board_parameters_seal();
    s->parameters_staged = false;
}

static void on_param_commit(session_t *s, const can_frame_t *f) {
    const message_param_commit_t m = message_param_commit_unpack(f);

    if (s->mode != SESSION_IDLE) {
        reply_nack(s, f, MESSAGE_NACK_REASON_BUSY, 0);
    } else if (m.count != PARAMS_COUNT) {
        reply_nack(s, f, MESSAGE_NACK_REASON_COUNT, PARAMS_COUNT);
    } else if (m.crc != params_crc32(&s->buffers->staged)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_CRC, 0);
    } else if (!store_accepts(&s->buffers->staged)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_PARAMETERS, 0);
    } else {
        session_use_staged(s);
        requests_committed(s);
        reply_ack(s, f, m.crc);
    }
}

/* ---- commands that answer a nonce ---- */

static void on_challenge(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_challenge_t m = message_challenge_unpack(f);
    nonce_t *const here = &s->link[s->asked].nonce;
    const message_nonce_t nonce = {.verb = m.verb, .nonce = nonce_issue(here, &s->random, m.verb, now_us)};

    links_reply(s, message_nonce_pack(&nonce), 0);
}

/* A nonce answers where it was asked for. */
static bool nonce_good(session_t *s, uint16_t verb, uint32_t nonce, uint32_t now_us) {
    return nonce_answer(&s->link[s->asked].nonce, verb, nonce, now_us);
}

static void on_execute(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_execute_t m = message_execute_unpack(f);

    if (!nonce_good(s, m.verb, m.nonce, now_us)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.verb != MESSAGE_EXECUTE_VERB_ARM) {
        const uint16_t reason = requests_execute(s, m.verb, now_us);

        if (reason == 0) {
            reply_ack(s, f, m.verb);
        } else {
            reply_nack(s, f, reason, m.verb);
        }
    } else {
        const uint16_t blocked = arming_blocked(s, s->asked);
        const uint32_t first = arming_arm(&s->arming, blocked, actuator(s), &s->random, now_us);

        if (first == 0U) {
            readiness_send(s, s->asked); /* first, so that the host can say what is missing */
            reply_nack(s, f, MESSAGE_NACK_REASON_BLOCKED, blocked);
        } else {
            requests_withdraw_bootloader(s);
            reply_ack(s, f, first);
        }
    }
}

/* The owner's link is the source of all that its flags do not leave to the other one. */
static run_links_t links_of_run(const session_t *s, unsigned flags) {
    const link_t other = s->asked == LINK_UART ? LINK_CAN : LINK_UART;

    return (run_links_t){
        .owner = s->asked,
        .samples = (flags & MESSAGE_RUN_BEGIN_SAMPLES_ELSEWHERE) != 0U ? other : s->asked,
        .setpoints = (flags & MESSAGE_RUN_BEGIN_SETPOINTS_ELSEWHERE) != 0U ? other : s->asked,
    };
}

static void on_run_begin(session_t *s, const can_frame_t *f, uint32_t now_us) {
    const message_run_begin_t m = message_run_begin_unpack(f);
    const unsigned flags = e2e_flags(f);

    if (!nonce_good(s, m.run, m.nonce, now_us)) {
        reply_nack(s, f, MESSAGE_NACK_REASON_NONCE, 0);
    } else if (m.run < MESSAGE_RUN_BEGIN_RUN_LOCKSTEP || m.run > MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE ||
               (m.run == MESSAGE_RUN_BEGIN_RUN_LOCKSTEP && flags != 0U)) { /* which one link paces */
        reply_nack(s, f, MESSAGE_NACK_REASON_UNSUPPORTED, m.run);
    } else {
        arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
        s->stand_alone = false;
        run_begin(s, m.run, links_of_run(s, flags));
        reply_ack(s, f, m.run | (uint32_t)s->run_tag << RUN_TAG_SHIFT);
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
    } else {
        telemetry_select(s, m.bank, m.mask);
        reply_ack(s, f, m.mask);
    }
}

static void on_disarm(session_t *s, const can_frame_t *f) {
    arming_disarm(&s->arming, ARMING_BLOCK_COMMAND);
    reply_ack(s, f, 0);
}

/* ---- receive ---- */

static void on_keepalive(session_t *s, const can_frame_t *f, uint32_t now_us) {
    if (s->run_owner == s->asked) { /* the link that armed is the one that must live */
        (void)arming_keepalive(&s->arming, message_keepalive_unpack(f).value, now_us);
    }
}

static void on_close(session_t *s, const can_frame_t *f) {
    reply_ack(s, f, 0);
    links_open(s, s->asked, false, false);
}

/* SAMPLE and SETPOINT are numbered by their step and looked at by run.c; the others count. */
void session_take_frame(session_t *s, link_t link, const can_frame_t *f, uint32_t now_us) {
    s->asked = link;
    if (permissions_greeting_missing(&s->link[link], f)) {
        if (f->id != MESSAGE_SAMPLE_B_ID) { /* its SAMPLE_A is answered */
            reply_nack(s, f, MESSAGE_NACK_REASON_GREETING, 0);
        }
        return;
    }
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
        on_hello(s, f);
        break;
    case MESSAGE_KEEPALIVE_ID:
        on_keepalive(s, f, now_us);
        break;
    case MESSAGE_CLOSE_ID:
        on_close(s, f);
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
    links_note_counter(&s->link[link], f);
}

bool session_frame_room(const session_t *s) {
    return outbox_room(s->link[LINK_CAN].outbox) >= FRAME_REPLIES;
}

void session_receive_frame(session_t *s, const can_frame_t *f, uint32_t now_us) {
    if (links_accept(s, LINK_CAN, f, now_us)) {
        session_take_frame(s, LINK_CAN, f, now_us);
    }
}

/* ---- transmit ---- */

size_t session_transmit(session_t *s, uint8_t *out, size_t room) {
    return outbox_take(s->link[LINK_UART].outbox, out, room);
}

bool session_frame_waits(const session_t *s) {
    return s->link[LINK_CAN].outbox->count > 0;
}

bool session_transmit_frame(session_t *s, can_frame_t *frame) {
    return outbox_take_frame(s->link[LINK_CAN].outbox, frame);
}

static uint8_t status_flags(const session_t *s, const session_link_t *l) {
    unsigned flags = 0;

    flags |= arming_armed(&s->arming) ? MESSAGE_STATUS_ARMED : 0U;
    flags |= s->live ? MESSAGE_STATUS_LIVE : 0U;
    flags |= s->parameters_staged ? MESSAGE_STATUS_STAGED : 0U;
    flags |= l->read_only ? MESSAGE_STATUS_READ_ONLY : 0U;
    return (uint8_t)flags;
}

static void send_status(session_t *s, link_t link) {
    session_link_t *const l = &s->link[link];
    const message_status_t status = {.mode = (uint16_t)s->mode,
                                     .blocked = arming_blocked(s, link),
                                     .faults = (uint16_t)(s->faults & 0xFFFFU)};
    const message_counters_t counters = {
        .rejected = l->rejected, .lost = l->lost, .dropped = l->outbox->dropped};
    const message_events_t events = {
        .saturated = s->saturated, .starved = s->starved, .disarm_cause = s->arming.cause};
    const message_sensors_t sensors = {.analog =
                                           (uint16_t)(s->health.railed | (unsigned)s->health.stuck << 8),
                                       .digital = (uint16_t)(s->health.gyro | (unsigned)s->health.accel << 8),
                                       .bus_failures = s->health.bus_failures};

    outbox_telemetry(l->outbox, message_status_pack(&status), status_flags(s, l));
    outbox_telemetry(l->outbox, message_counters_pack(&counters), 0);
    outbox_telemetry(l->outbox, message_events_pack(&events), 0);
    if (s->can != NULL) {
        const message_can_health_t health = {.transmit_errors = s->can->transmit_errors,
                                             .receive_errors = s->can->receive_errors,
                                             .bus_offs = s->can->bus_offs};
        const unsigned off = s->can->bus_off ? MESSAGE_CAN_HEALTH_BUS_OFF : 0U;

        outbox_telemetry(l->outbox, message_can_health_pack(&health), (uint8_t)(s->can->last_error | off));
    }
    outbox_telemetry(l->outbox, message_sensors_pack(&sensors), 0);
    readiness_send(s, link);
}

/* The next value for the keep-alive of the host that armed, before all that waits for its link. */
static void issue_keepalive(session_t *s, uint32_t now_us) {
    const message_keepalive_value_t m = {.value = arming_issue(&s->arming, &s->random, now_us)};

    if (m.value != 0U) {
        outbox_urgent(s->link[s->run_owner].outbox, message_keepalive_value_pack(&m), 0);
    }
}

/* While armed in real time a step has to come: without one the last pulses would stay, whatever the sensors
 * say. */
static bool steps_overdue(session_t *s, uint32_t now_us) {
    const uint32_t limit_us = STEPS_MISSING * s->params->period_us;

    if (!arming_armed(&s->arming) || s->step != s->step_seen) {
        s->step_seen = s->step;
        s->step_seen_us = now_us;
    }
    return now_us - s->step_seen_us > (limit_us > STEPS_MISSING_US ? limit_us : STEPS_MISSING_US);
}

void session_poll(session_t *s, uint32_t now_us) {
    links_poll(s, now_us);
    if (steps_overdue(s, now_us)) {
        s->faults |= BOARD_FAULT_LATE;
    }
    run_poll(s, now_us);
    arming_poll(&s->arming, arming_blocked(s, s->run_owner), now_us);
    issue_keepalive(s, now_us);
    setpoint_poll(s, now_us);
    telemetry_send_words(s);
    for (unsigned i = 0; i < LINKS; i++) {
        poll_long_replies(s, &s->link[i], now_us);
    }
    if (now_us - s->time_us >= TIME_EVERY_US) {
        const message_time_t m = {.step = s->step, .time = now_us};

        s->time_us = now_us;
        links_telemetry(s, message_time_pack(&m), s->mode != SESSION_IDLE ? s->run_tag : 0U);
    }
    if (now_us - s->status_us >= STATUS_EVERY_US) {
        s->status_us = now_us;
        for (unsigned i = 0; i < LINKS; i++) {
            if (s->link[i].open) {
                send_status(s, (link_t)i);
            }
        }
    }
}

/* Everything but the buffers. */
static void begin(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params) {
    memset(s, 0, sizeof *s);
    s->board = board;
    s->control = control;
    s->params = params;
    s->buffers = buffers;
    buffers->staged = *params;
    links_init(s);
    arming_init(&s->arming);
    random_init(&s->random, board->unique_id[0] ^ board->unique_id[1] ^ board->unique_id[2] ^ board->seed);
    s->run_tag =
        (uint8_t)(random_next(&s->random) >> 28); /* anywhere: not the same run again after a reset */
    s->run_owner = LINK_NONE;
    s->can_kbit = params->can_bitrate_kbit;
    telemetry_select_nothing(s);
    control_init(control, &params->control);
}

void session_init(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params) {
    memset(buffers, 0, sizeof *buffers);
    for (unsigned i = 0; i < LINKS; i++) {
        outbox_init(&buffers->outbox[i]);
    }
    slcan_rx_init(&buffers->rx);
    begin(s, buffers, board, control, params);
}

void session_recover(session_t *s, session_buffers_t *buffers, const board_identity_t *board,
                     control_t *control, params_t *params) {
    bool open[LINKS];
    bool read_only[LINKS];

    for (unsigned i = 0; i < LINKS; i++) {
        open[i] = s->link[i].open;
        read_only[i] = s->link[i].read_only;
    }
    begin(s, buffers, board, control, params);
    for (unsigned i = 0; i < LINKS; i++) {
        s->link[i].open = open[i];
        s->link[i].read_only = read_only[i];
    }
    s->link[LINK_UART].open = true; /* whose flag may be what was damaged: it is said there in any case */
    s->arming.cause = ARMING_BLOCK_FAULT;
}
