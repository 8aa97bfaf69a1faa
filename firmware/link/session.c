#include "session.h"
#include "arming_reasons.h"
#include "news.h"
#include "pilot.h"
#include "session_battery.h"
#include "stepping.h"
#include "switches.h"
#include <string.h>

/* The ACK needs up to 3 ms on the UART after at most 93 ms of queued frames: the host receives it before the
 * board leaves. */
#define BOOTLOADER_AFTER_US 100000U

void session_report(session_t *s, const session_report_t *report, uint32_t now_us) {
    s->status.faults = report->faults | staging_faults(&s->staging);
    s->status.can = report->can;
    s->status.sensors = report->sensors;
    session_follow_battery(s, now_us);
    session_follow_switches(s, report->switch_closed, now_us);
}

/* True when steps come too late for a board that is armed. One that a pilot flies may miss a few. */
static bool late(const session_t *s) {
    return s->step_overdue || (!session_flown(s) && (s->status.faults & BOARD_FAULT_LATE) != 0U);
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

/* A sample, words of a step or a long reply wait for room in an outbox. */
static bool waits_for_room(const session_t *s) {
    bool waits = run_sample_waits(&s->run) || telemetry_waits(&s->telemetry);

    for (unsigned i = 0; i < LINKS; i++) {
        waits = waits || long_replies_wait(&s->long_replies[i]);
    }
    return waits;
}

uint32_t session_turn_within_us(const session_t *s, uint32_t now_us) {
    const bool lockstep = s->run.mode == RUN_LOCKSTEP;

    if (!(lockstep || arming_armed(&s->arming)) || waits_for_room(s)) {
        return 0;
    }
    if (lockstep) {
        return SESSION_LOCKSTEP_US;
    }
    uint32_t within_us = arming_within_us(&s->arming, now_us);

    if (run_injected(&s->run)) {
        const uint32_t stale_us = injected_within_us(&s->run.injected, s->params->period_us, now_us);

        within_us = stale_us < within_us ? stale_us : within_us;
    }
    return within_us < SESSION_ARMED_US ? within_us : SESSION_ARMED_US;
}

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
    const uint32_t pilot = session_pilot(s);

    staging_apply(&s->staging, s->params, session_armed(s));
    s->system = control_system(&s->params->control);
    session_pilot_changed(s, pilot);
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

size_t session_transmit(session_buffers_t *buffers, uint8_t *out, size_t room) {
    return outbox_pop_text(&buffers->routing.outbox[LINK_UART], out, room);
}

bool session_transmit_frame(session_buffers_t *buffers, can_frame_t *frame) {
    return outbox_pop_frame(&buffers->routing.outbox[LINK_CAN], frame);
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
    if (session_armed(s)) { /* else there is nothing to disarm */
        arming_poll(&s->arming, session_arming_blocked(s, s->run.links.owner), now_us);
    }
    session_issue_keepalive(s, now_us);
    setpoint_poll(&s->run.setpoint, session_armed(s), arming_driving(&s->arming), s->run.step, now_us);
    session_take_sticks(s);
    session_send_news(s, now_us);
    session_send_words(s);
    session_send_long_replies(s, now_us);
    session_send_time(s, now_us);
}

/* Initialises everything but the buffers. */
static void begin(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params, const store_report_t *saved) {
    memset(s, 0, sizeof *s);
    s->board = board;
    s->control = control;
    s->params = params;
    s->system = control_system(&params->control);
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
