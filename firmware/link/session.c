#include "session.h"
#include <string.h>

/* The ACK needs up to 3 ms on the UART after at most 93 ms of queued frames: the host receives it before the
 * board leaves. */
#define BOOTLOADER_AFTER_US 100000U

/* ---- state ---- */

bool session_armed(const session_t *s) {
    return arming_armed(&s->arming);
}

/* ---- whether it may be armed ---- */

/* The system in use; NULL: nothing is checked. */
static const control_system_t *checked(const session_t *s) {
    return USED_ACTUATORS && s->run.mode == RUN_REALTIME ? control_system(&s->params->control) : NULL;
}

/* True when the board started with the pin set of the actuator that the system drives. */
static bool actuator_present(const session_t *s) {
    if (!USED_ACTUATORS || (s->status.faults & BOARD_FAULT_STRAP) != 0) {
        return false;
    }
    switch (control_system(&s->params->control)->output) {
    case CONTROL_OUTPUT_PULSES:
        return s->board->pins == BOARD_PINS_STANDARD;
    case CONTROL_OUTPUT_BRIDGE:
        return s->board->pins == BOARD_PINS_BRIDGE;
    case CONTROL_OUTPUT_ROTORS:
        return s->board->pins == BOARD_PINS_QUADROTOR;
    case CONTROL_OUTPUT_WHEELS:
        return s->board->pins == BOARD_PINS_WHEELS;
    default:
        return false;
    }
}

#if USED_RECEIVER
static uint32_t receiver_chosen(const session_t *s) {
    return s->params->receiver;
}

static bool has_receiver(const session_t *s) {
    return s->params->receiver != 0U && control_system(&s->params->control)->has_receiver;
}
#else
static uint32_t receiver_chosen(const session_t *s) {
    (void)s;
    return 0;
}

static bool has_receiver(const session_t *s) {
    (void)s;
    return false;
}
#endif

bool session_piloted(const session_t *s) {
    return has_receiver(s) && arming_armed(&s->arming) && s->arming.by_switch;
}

/* A vehicle on wheels is safe when it is off; one in the air is not. */
static bool flown(const session_t *s) {
    return session_piloted(s) && control_system(&s->params->control)->takeoff != NULL;
}

static bool faulty(const session_t *s) {
    const unsigned blocking = flown(s) ? SESSION_FAULTS_FLOWN : SESSION_FAULTS_BLOCKING;

    return (s->status.faults & blocking) != 0 || s->step_overdue;
}

/* A pilot may not raise the throttle, nor anyone move the vehicle, before the rotors turn. */
static bool past_takeoff(const session_t *s) {
    return flown(s) ? arming_driving(&s->arming) : arming_armed(&s->arming);
}

/* ARMING_BLOCK_* for the host of a link; LINK_NONE: without a host. */
static uint16_t arming_blocked(const session_t *s, link_t link) {
    const routing_link_t *const l = link != LINK_NONE ? &s->routing.link[link] : NULL;
    const control_system_t *const system = control_system(&s->params->control);
    const run_mode_t mode = s->run.mode;
    unsigned blocked = 0;

    blocked |= l != NULL && l->greeted ? 0U : ARMING_BLOCK_HELLO;
    blocked |= mode == RUN_IDLE ? ARMING_BLOCK_IDLE : 0U;
    blocked |= mode == RUN_LOCKSTEP ? ARMING_BLOCK_LOCKSTEP : 0U;
    blocked |= faulty(s) ? ARMING_BLOCK_FAULT : 0U;
    blocked |= l != NULL && l->open && !l->read_only ? 0U : ARMING_BLOCK_CLOSED;
    blocked |= mode != RUN_IDLE && s->run.links.owner != link ? ARMING_BLOCK_OWNER : 0U;
    blocked |= run_injected(&s->run) && injected_stale(&s->run.injected) ? ARMING_BLOCK_SAMPLES : 0U;
    blocked |= actuator_present(s) ? 0U : ARMING_BLOCK_PINS;
    blocked |= has_receiver(s) ? 0U : arming_switch_owns(&s->arming);
    blocked |= system->output != CONTROL_OUTPUT_NONE && s->staging.unsafe != PARAMS_COUNT
                   ? ARMING_BLOCK_PARAMETER
                   : 0U;
    blocked |= readiness_blocked(&s->readiness, checked(s), past_takeoff(s));
    return (uint16_t)blocked;
}

static uint32_t hold_us(const session_t *s) {
    return 1000U * s->params->arm_hold_ms;
}

bool session_arm(session_t *s, const request_t *q, uint16_t *blocked) {
    *blocked = arming_blocked(s, q->link);
    /* Hosts before protocol version 3 send no asker. On a bus that a host of this version has greeted, such a
     * host is still refused. */
    *blocked |= (uint16_t)(s->nonce[q->link].asker == 0 ? ARMING_BLOCK_HELLO : 0U);
    if (*blocked == 0) {
        s->bootloader_asked = false;
    }
    return arming_arm(&s->arming, *blocked, hold_us(s), q->now_us);
}

void session_link_lost(session_t *s, link_t link, uint16_t cause) {
    if (s->run.links.owner == link) {
        arming_disarm_host(&s->arming, cause);
    }
}

/* ---- a turn: state of the board, and orders to it ---- */

#if USED_RECEIVER
void session_receive_sticks(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us) {
    s->receiver.by_sticks = s->params->receiver % 2U == 0U;
    if (s->params->receiver < RECEIVER_PPM) {
        receiver_push(&s->receiver, &s->buffers->crsf, bytes, count, now_us);
    }
}

void session_receive_edges(session_t *s, const uint16_t *stamps_us, size_t count, uint32_t now_us) {
    if (ppm_follow(&s->buffers->ppm, stamps_us, count, now_us) && s->params->receiver >= RECEIVER_PPM) {
        receiver_pulses(&s->receiver, s->buffers->ppm.pulse_us, now_us);
    }
}

/* The sticks of a run in real time are the receiver's. */
static void take_sticks(session_t *s) {
    if (s->run.mode == RUN_REALTIME && has_receiver(s)) {
        const receiver_t *const r = &s->receiver;

        setpoint_of_board(&s->run.setpoint, r->throttle_q15, r->words, RECEIVER_WORDS);
    }
}
#endif

void session_begin_run(session_t *s, uint16_t run, run_links_t links) {
    s->bootloader_asked = false;
#if USED_RECEIVER
    if (run != MESSAGE_RUN_BEGIN_RUN_LOCKSTEP && has_receiver(s)) {
        links.setpoints = LINK_NONE;
    }
#endif
#if CONTROL_LEARNS
    s->own_state = run == MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;
#endif
    run_begin(&s->run, run, links, control_system(&s->params->control));
    telemetry_begin(&s->telemetry);
    control_init(s->control, &s->params->control);
    readiness_begin(&s->readiness, control_system(&s->params->control));
}

#if USED_RECEIVER
/* What keeps a board that is not armed from being armed, on the side of the pilot: READINESS_. */
static uint16_t pilot_missing(const session_t *s, bool heard, bool locked) {
    unsigned missing = locked ? READINESS_LOCKED : 0U;

    missing |= s->params->calibrated != 0U ? 0U : READINESS_RAW;
    if (!heard) {
        missing |= READINESS_RECEIVER;
    } else if (arming_switch_used_up(&s->arming)) {
        missing |= READINESS_SWITCH_ON;
    }
    return (uint16_t)(arming_armed(&s->arming) ? 0U : missing);
}

/* The switch of the pilot arms and disarms, in any run in real time. A run begins without a host, too,
 * because the step has to see the switch off before it is on. While the receiver is not heard an armed board
 * leaves the rotors to the step; a board that is not armed has to see the switch off once more. Off is seen
 * when the frames say so, at any rate of frames; an armed board obeys the switch as the step reads it. */
static void follow_pilot(session_t *s, bool locked, uint32_t now_us) {
    const bool heard = receiver_heard(&s->receiver, now_us);
    const bool on = receiver_rotors_on(&s->receiver);
    const bool read = on || receiver_rotors_off(&s->receiver) || arming_armed(&s->arming);

    if (heard && read) {
        (void)arming_switch(&s->arming, on, now_us);
    } else if (!heard && !arming_armed(&s->arming)) {
        arming_switch_unread(&s->arming);
    }
    s->readiness.outside |= pilot_missing(s, heard, locked);
    if (s->arming.switch_trying) {
        arming_try_switch(&s->arming, arming_blocked(s, s->run.links.owner), ARMING_SWITCH_TRY_US, hold_us(s),
                          now_us);
    }
#if USED_WHEELS
    /* A fall, a break, and why it was disarmed are kept until the run ends: when the pilot has switched off.
     */
    const bool kept =
        (s->readiness.stopped & READINESS_FALLEN) != 0U || (s->status.faults & BOARD_FAULT_BRIDGE) != 0U;
    if (kept && s->run.stand_alone && !arming_armed(&s->arming) && receiver_rotors_off(&s->receiver)) {
        run_end(&s->run);
    }
#endif
    if (s->run.mode != RUN_IDLE || s->bootloader_asked || !actuator_present(s)) {
        s->busy_us = now_us;
    } else if (now_us - s->busy_us >= SESSION_ALONE_US) {
        session_begin_run(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE,
                          (run_links_t){LINK_NONE, LINK_NONE, LINK_NONE});
    }
}
#endif

void session_end_alone(session_t *s, uint32_t now_us) {
#if USED_RECEIVER
    if (has_receiver(s) && s->run.stand_alone && !arming_armed(&s->arming)) {
        run_end(&s->run);
    }
    s->busy_us = now_us;
#else
    (void)s, (void)now_us;
#endif
}

/* Closing the switch while no run is on starts a live run of the system in use. That run ends when it is
 * disarmed, so that the next closing begins with a fresh state. */
static void follow_switch(session_t *s, bool closed, uint32_t now_us) {
    if (!USED_ACTUATORS) {
        return;
    }
    if (arming_switch(&s->arming, closed, now_us) && s->run.mode == RUN_IDLE) {
        session_begin_run(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE,
                          (run_links_t){LINK_NONE, LINK_NONE, LINK_NONE});
    }
    if (s->arming.switch_trying) {
        arming_try_switch(&s->arming, arming_blocked(s, s->run.links.owner), ARMING_SWITCH_READY_US,
                          hold_us(s), now_us);
    }
    if (s->run.stand_alone && !arming_armed(&s->arming) && !s->arming.switch_trying) {
        run_end(&s->run);
    }
}

void session_report(session_t *s, const session_report_t *report, uint32_t now_us) {
    s->status.faults = report->faults | staging_faults(&s->staging);
    s->status.can = report->can;
    s->status.sensors = report->sensors;
#if USED_RECEIVER
    s->readiness.outside = 0;
#endif
#if USED_BATTERY
    battery_follow(&s->battery, report->battery_read, report->battery_counts);
    s->readiness.outside = battery_missing(&s->battery, s->params);
#endif
#if USED_RECEIVER
    if (has_receiver(s)) {
        follow_pilot(s, report->switch_closed, now_us);
        return;
    }
#endif
    follow_switch(s, report->switch_closed, now_us);
}

/* True when steps come too late for a board that is armed. One that a pilot flies may miss a few. */
static bool late(const session_t *s) {
    return s->step_overdue || (!flown(s) && (s->status.faults & BOARD_FAULT_LATE) != 0U);
}

session_orders_t session_take_orders(session_t *s, uint32_t now_us) {
    return (session_orders_t){
        .mode = s->run.mode,
        .begun = run_pop_begin(&s->run),
        .live = s->run.live,
        .armed = arming_armed(&s->arming),
        .driving = arming_driving(&s->arming),
        .late = arming_armed(&s->arming) && late(s),
        .bootloader = s->bootloader_asked && now_us - s->bootloader_us >= BOOTLOADER_AFTER_US,
        .period_us = s->run.mode == RUN_REALTIME ? s->params->period_us : 0U,
        .can_kbit = s->routing.can_kbit,
    };
}

/* ---- a run, step by step ---- */

/* The next injected sample: in lockstep one that waits, when its replies have room. */
static bool next_sample(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    const link_t pacer = run_pacer(&s->run);

    if (pacer != LINK_NONE &&
        !(run_sample_waits(&s->run) && telemetry_has_room(&s->telemetry, &s->routing, pacer))) {
        return false;
    }
    run_next_sample(&s->run, control_system(&s->params->control)->marks_missing, raw, setpoint);
    return true;
}

bool session_take_inputs(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    if (!s->run.live) {
        return next_sample(s, raw, setpoint);
    }
    *setpoint = s->run.setpoint.value;
    setpoint_copy_commands(&s->run.setpoint, raw);
    return true;
}

/* Flags of STEP. saturated: a raw count of that step was outside its range. */
static uint8_t step_flags(const session_t *s, bool saturated) {
    unsigned flags = 0;

    flags |= arming_armed(&s->arming) ? MESSAGE_STEP_ARMED : 0U;
    flags |= s->run.live ? MESSAGE_STEP_LIVE : 0U;
    flags |= saturated ? MESSAGE_STEP_SATURATED : 0U;
    return (uint8_t)flags;
}

static void send_words(session_t *s) {
    telemetry_send_words(&s->telemetry, &s->routing, control_words(s->control), run_pacer(&s->run));
}

void session_stepped(session_t *s) {
    const plumb_params_t *const params = &s->params->control;
    const bool saturated = control_saturated(s->control, params);

    if (s->run.mode == RUN_REALTIME) {
        setpoint_report(&s->run.setpoint, &s->routing, s->run.links.setpoints, s->run.step);
    }
    readiness_step(&s->readiness, checked(s), s->params, control_words(s->control), session_armed(s));
    telemetry_step(&s->telemetry, &s->routing, s->control, params, s->run.step, step_flags(s, saturated));
    run_stepped(&s->run, saturated);
    send_words(s);
}

void session_repeat_step(session_t *s, const request_t *q, uint16_t step) {
    telemetry_repeat_step(&s->telemetry, &s->routing, q, step, step_flags(s, false));
}

/* ---- parameters, bootloader ---- */

void session_apply_staged(session_t *s) {
    if (s->staging.table->control.system != s->params->control.system) {
        telemetry_select_nothing(&s->telemetry); /* another record */
    }
#if CONTROL_LEARNS
    s->own_state = s->own_state && s->run.mode != RUN_IDLE;
#endif
    if (s->run.mode != RUN_IDLE) {
        control_retune(s->control, &s->params->control, &s->staging.table->control);
    }
    const bool piloted = has_receiver(s);
    const uint32_t receiver = receiver_chosen(s);

    staging_apply(&s->staging, s->params, session_armed(s));
    if (has_receiver(s) != piloted || receiver_chosen(s) != receiver) {
        /* a pilot's from now on, or the board's, or of another line */
#if USED_RECEIVER
        s->receiver = (receiver_t){0};
#endif
        arming_switch_unread(&s->arming);
    }
}

#if CONTROL_LEARNS
/* The state of a run stays until the next one begins. */
void session_keep_learned(session_t *s) {
    const control_system_t *const system = control_system(&s->params->control);

    if (s->own_state && system->learned_word != 0U) {
        staging_learn(s->params, system->learned_parameter,
                      (uint32_t)control_words(s->control)[system->learned_word]);
    }
}
#endif

void session_report_parameters(session_t *s, uint32_t crc) {
    const message_param_used_t m = {.step = s->run.step, .crc = crc};

    if (s->run.mode != RUN_IDLE) {
        routing_telemetry(&s->routing, message_param_used_pack(&m), s->run.tag);
    }
}

void session_ask_bootloader(session_t *s, uint32_t now_us) {
    s->bootloader_asked = true;
    s->bootloader_us = now_us;
}

/* ---- transmit ---- */

size_t session_transmit(session_t *s, uint8_t *out, size_t room) {
    return outbox_pop_text(s->routing.link[LINK_UART].outbox, out, room);
}

bool session_transmit_frame(session_t *s, can_frame_t *frame) {
    return outbox_pop_frame(s->routing.link[LINK_CAN].outbox, frame);
}

void session_send_readiness(session_t *s, link_t link) {
    const message_plausibility_t m = readiness_message(&s->readiness, checked(s));

    outbox_telemetry(s->routing.link[link].outbox, message_plausibility_pack(&m), 0);
}

/* Sends the status to one open link: the frames that changed, or all of them when the period is over. */
static void send_status(session_t *s, link_t link, bool all, uint32_t now_us) {
    const routing_link_t *const l = &s->routing.link[link];
    message_status_t status = {.mode = (uint16_t)s->run.mode, .blocked = arming_blocked(s, link)};
    const message_events_t events = {
        .saturated = s->run.saturated, .starved = s->run.starved, .disarm_cause = s->arming.cause};
    const message_plausibility_t plausibility = readiness_message(&s->readiness, checked(s));
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
    status_send(&s->status, &round, &status, (uint8_t)flags, &events, &plausibility);
#if USED_BATTERY
    if (all && s->params->battery_min_mv != 0U) {
        const message_battery_t battery = battery_message(&s->battery, s->params);

        outbox_telemetry(l->outbox, message_battery_pack(&battery), 0);
    }
#endif
}

/* In lockstep nothing can be armed, and the host compares every step: a change waits for the period. */
static void send_news(session_t *s, uint32_t now_us) {
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

/* Sends the next keep-alive value to the host that armed, ahead of all frames queued for its link. */
static void issue_keepalive(session_t *s, uint32_t now_us) {
    const message_keepalive_value_t m = {.arming = s->arming.number,
                                         .value = arming_issue(&s->arming, &s->random, now_us)};

    if (m.value != 0U) {
        outbox_urgent(s->routing.link[s->run.links.owner].outbox, message_keepalive_value_pack(&m), 0);
    }
}

static void send_long_replies(session_t *s, uint32_t now_us) {
    const identity_t identity = {.board = s->board,
                                 .params = s->params,
                                 .staging = &s->staging,
                                 .faults = s->status.faults,
                                 .now_us = now_us};

    for (unsigned i = 0; i < LINKS; i++) {
        long_replies_poll(&s->long_replies[i], s->routing.link[i].outbox, &identity);
    }
}

static void send_time(session_t *s, uint32_t now_us) {
    if (status_time_due(&s->status, now_us)) {
        const message_time_t m = {.step = s->run.step, .time = now_us};

        routing_telemetry(&s->routing, message_time_pack(&m), s->run.mode != RUN_IDLE ? s->run.tag : 0U);
    }
}

/* The counts of injected samples are checked like the board's own sensors. */
static void check_injected(session_t *s) {
    const injected_t *const in = &s->run.injected;

    s->status.injected = run_injected(&s->run);
    if (s->status.injected && (in->railed | in->stuck) != 0) {
        s->status.sensors.railed = in->railed;
        s->status.sensors.stuck = in->stuck;
        s->status.faults |= BOARD_FAULT_SENSOR;
    }
}

/* Not inlined: tests set a breakpoint here. */
__attribute__((noinline)) void session_poll(session_t *s, uint32_t now_us) {
    if (routing_poll(&s->routing, s->params->can_bitrate_kbit, now_us)) {
        session_link_lost(s, LINK_CAN, ARMING_BLOCK_CLOSED);
    }
    s->step_overdue = run_step_overdue(&s->run, s->params->period_us, now_us);
    s->status.faults |= s->step_overdue ? BOARD_FAULT_LATE : 0U;
    run_poll(&s->run, s->params->period_us, now_us);
    check_injected(s);
    arming_poll(&s->arming, arming_blocked(s, s->run.links.owner), now_us);
    issue_keepalive(s, now_us);
    setpoint_poll(&s->run.setpoint, session_armed(s), arming_driving(&s->arming), s->run.step, now_us);
#if USED_RECEIVER
    take_sticks(s);
#endif
    send_news(s, now_us);
    send_words(s);
    send_long_replies(s, now_us);
    send_time(s, now_us);
}

/* ---- start ---- */

/* Initialises everything but the buffers. */
static void begin(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params, const store_report_t *saved) {
    memset(s, 0, sizeof *s);
    s->board = board;
    s->control = control;
    s->params = params;
    s->buffers = buffers;
    random_init(&s->random, board->unique_id[0] ^ board->unique_id[1] ^ board->unique_id[2] ^ board->seed);
    routing_init(&s->routing, &buffers->routing, params->can_bitrate_kbit);
    run_init(&s->run, &buffers->run, random_next(&s->random));
    telemetry_init(&s->telemetry, buffers->digest);
    staging_init(&s->staging, &buffers->staged, params);
    staging_loaded(&s->staging, saved);
    arming_init(&s->arming, random_next(&s->random));
    control_init(control, &params->control);
}

void session_init(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params, const store_report_t *saved) {
    memset(buffers, 0, sizeof *buffers);
    routing_buffers_init(&buffers->routing);
    commands_init(&buffers->commands, board->unique_id);
    begin(s, buffers, board, control, params, saved);
}

/* A flag in damaged memory: its byte may be neither 0 nor 1, which is no bool. */
static bool damaged_flag(const bool *flag) {
    uint8_t byte;

    memcpy(&byte, flag, sizeof byte);
    return byte != 0U;
}

void session_recover(session_t *s, session_buffers_t *buffers, const board_identity_t *board,
                     control_t *control, params_t *params, const store_report_t *saved) {
    bool open[LINKS];
    bool read_only[LINKS];

    for (unsigned i = 0; i < LINKS; i++) {
        open[i] = damaged_flag(&s->routing.link[i].open);
        read_only[i] = damaged_flag(&s->routing.link[i].read_only);
    }
    begin(s, buffers, board, control, params, saved);
    /* The damage may have hit the UART's flag: its host is informed in any case. */
    routing_open(&s->routing, LINK_UART, true, read_only[LINK_UART]);
    routing_open(&s->routing, LINK_CAN, open[LINK_CAN], read_only[LINK_CAN]);
    s->arming.cause = ARMING_BLOCK_FAULT;
}
