/* Session: everything between the links and the control step, composed from the modules below.
 *
 * Each module owns one part of the state: a struct that only the file of the same name writes. Calls go
 * downwards only: requests.c (the requests of a host) calls the session, the session calls the modules, and
 * no module knows the session.
 *
 *     routing     links: open, greeted, what was received; outboxes
 *     run         injected samples, setpoints, step counter
 *     telemetry   frames that a step sends
 *     staging     parameters that are received but not yet in use
 *     receiver    sticks and switches of a pilot, by radio
 *     battery     voltage and current
 *     arming      whether the actuator may be driven; readiness: whether the sensors allow it
 *     status      state of the board, sent periodically
 *
 * No hardware, no heap; the caller owns all memory. Time is an argument: us of the board's clock, modulo
 * 2^32. A turn of the main loop (firmware/app/loop.c):
 *
 *     requests_receive()        bytes of the UART, at most requests_room()
 *     requests_receive_frame()  frames of CAN, while requests_frame_room()
 *     session_receive_sticks(), session_receive_edges()  lines of the receiver, where an image has one
 *     session_report()          the state of the board
 *     session_poll()            may disarm
 *     session_take_orders()     orders to the board
 *     per sample                session_take_inputs(), control_step(), actuate if driving, session_stepped()
 *     session_transmit()        text for the UART; session_transmit_frame() for CAN
 *
 * Unless the orders say driving, the outputs are at neutral. */
#ifndef PLUMB_LINK_SESSION_H
#define PLUMB_LINK_SESSION_H

#include "arming.h"
#include "battery.h"
#include "commands.h"
#include "generated/used_parts.h"
#include "long_replies.h"
#include "nonce.h"
#include "readiness.h"
#include "receiver.h"
#include "run.h"
#include "staging.h"
#include "status.h"
#include "systems/control.h"
#include "telemetry.h"

#define SESSION_FAULTS_BLOCKING 0xE0FFU  /* of BOARD_FAULT_*: these disarm, */
#define SESSION_FAULTS_FLOWN    0x6000U  /* and these alone a board that a pilot armed: STALLED, UPSET */
#define SESSION_ALONE_US        1000000U /* without a run for so long the board begins one for its pilot */

/* Buffers: queued frames, samples and digests, and parameters not in use yet. They need no check word: frames
 * carry a CRC, and staged parameters are committed by theirs. */
typedef struct {
    routing_buffers_t routing;
    commands_t commands;
    params_t staged;
    run_buffers_t run;
    uint32_t digest[RUN_QUEUE_LENGTH];
    status_news_t news[LINKS];
#if USED_RECEIVER
    crsf_t crsf;
    ppm_t ppm;
#endif
} session_buffers_t;

/* State that decides whether and how an actuator moves: the board keeps a check word over all of it
 * (board_memory_seal()). Large data that decides nothing belongs into the buffers. */
typedef struct {
    routing_t routing;
    const board_identity_t *board;
    control_t *control;
    params_t *params; /* in use */
    session_buffers_t *buffers;
    run_t run;
    telemetry_t telemetry;
    staging_t staging;
    arming_t arming;
    readiness_t readiness;
    status_t status;
#if USED_RECEIVER
    receiver_t receiver;
    uint32_t busy_us; /* when a run was last on, or a host last asked for a board without one */
#endif
#if USED_BATTERY
    battery_t battery;
#endif
#if CONTROL_LEARNS
    bool own_state; /* *control comes from a run on the board's own sensors with the parameters in use */
#endif
    bool step_overdue; /* no step of the run in real time comes (run.h) */
    random_t random;
    nonce_t nonce[LINKS]; /* valid only on the link that asked for it */
    long_replies_t long_replies[LINKS];
    bool bootloader_asked;
    uint32_t bootloader_us; /* when the bootloader was asked for */
} session_t;

/* State of the board in a turn of the loop. */
typedef struct {
    uint32_t faults;    /* BOARD_FAULT_*; with one of SESSION_FAULTS_BLOCKING the next poll disarms */
    bool switch_closed; /* the arm switch: closing it arms, opening it disarms (arming.h) */
    const board_can_health_t *can; /* sent with the status; the caller keeps it */
    board_health_t sensors;        /* the details of BOARD_FAULT_SENSOR, sent as SENSORS */
#if USED_BATTERY
    bool battery_read; /* there are new counts: */
    uint16_t battery_counts[BATTERY_INPUTS];
#endif
} session_report_t;

/* Orders of the session to the board in a turn of the loop. */
typedef struct {
    run_mode_t mode;
    bool begun; /* a run has begun: state, step number and digest are reset; true once for each */
    bool live;  /* real time with the board's own sensors */
    bool armed;
    bool driving;       /* armed, and neutral was held long enough: the actuator may move */
    bool late;          /* armed although steps come late: the watchdog is not fed */
    bool bootloader;    /* enter the ROM bootloader: it was asked for, and the reply has had time to go out */
    uint32_t period_us; /* of the timer; 0: it stands still */
    uint32_t can_kbit;  /* of CAN: the parameter; a change waits until no host is connected over CAN */
} session_orders_t;

/* Start from *params (valid; see params_default()), loaded as *saved says, with both links closed, idle and
 * disarmed. */
void session_init(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params, const store_report_t *saved);

/* Start again after the memory of *s was damaged: like session_init(), but with ARMING_BLOCK_FAULT as the
 * cause of disarming. Kept are which links are open (the UART always), so that their hosts are informed, and
 * the frames that wait to be sent. */
void session_recover(session_t *s, session_buffers_t *buffers, const board_identity_t *board,
                     control_t *control, params_t *params, const store_report_t *saved);

/* ---- for the main loop ---- */

/* Pass the state of the board to the session. Call on every turn. */
void session_report(session_t *s, const session_report_t *report, uint32_t now_us);

#if USED_RECEIVER
/* Handle bytes of the receiver. In a run in real time of a system that has one, while the parameter
 * `receiver` is not 0, they set setpoint and commands, and no host does. Its switch arms (follow_pilot()).
 */
void session_receive_sticks(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* The same for the edges of its pulse train (ppm.h), also when none have come. Only one of the two counts, by
 * the parameter. */
void session_receive_edges(session_t *s, const uint16_t *stamps_us, size_t count, uint32_t now_us);
#endif

/* True while a pilot's switch holds the board armed. Then no host ends or begins a run, and the link of a
 * host does not matter. Of the faults of a board that flies only SESSION_FAULTS_FLOWN, and steps that do not
 * come, disarm: in the air a reason that is none is a crash. Its step handles lost sensors and a lost
 * receiver. */
bool session_piloted(const session_t *s);

/* Keep-alive, periodic telemetry, long replies. Call on every turn of the loop after session_report(), at
 * least once per millisecond. */
void session_poll(session_t *s, uint32_t now_us);

/* The orders to the board, until the next poll. */
session_orders_t session_take_orders(session_t *s, uint32_t now_us);

/* The inputs of the next step. Live: raw holds the counts of the sensors, the setpoint and the commands are
 * added. Lockstep: false until a sample is waiting and its replies have room. Real time, injected: call on
 * every tick; without a new sample the last one is held and counted. */
bool session_take_inputs(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint);

/* Call after control_step(): sends the digest and the selected words. */
void session_stepped(session_t *s);

/* Remove up to room bytes for the UART; returns how many. Order is kept, a frame may be split between two
 * calls. */
size_t session_transmit(session_t *s, uint8_t *out, size_t room);

/* Remove the next frame for CAN; false when none waits. */
bool session_transmit_frame(session_t *s, can_frame_t *frame);

bool session_armed(const session_t *s);

/* ---- for requests.c, which has checked nonce and permission ---- */

void session_begin_run(session_t *s, uint16_t run, run_links_t links); /* run: MESSAGE_RUN_BEGIN_RUN_* */

/* Arm for the host of this request; false when *blocked (ARMING_BLOCK_*) is not 0. */
bool session_arm(session_t *s, const request_t *q, uint16_t *blocked);

/* A link can no longer control: if its host armed the board, disarm at once, for this cause. */
void session_link_lost(session_t *s, link_t link, uint16_t cause);

/* Send the STEP of one of the last RUN_QUEUE_LENGTH steps again. */
void session_repeat_step(session_t *s, const request_t *q, uint16_t step);

/* Put the staged parameters into use, between two steps. Call only while no run is on, or when only live
 * parameters change: the run goes on without a jump of its outputs (control_retune()). */
void session_apply_staged(session_t *s);

/* Put what the last run has learned on the board's own sensors into the parameters in use. Call only while no
 * run is on. */
#if CONTROL_LEARNS
void session_keep_learned(session_t *s);
#else
static inline void session_keep_learned(session_t *s) {
    (void)s;
}
#endif

/* Send PARAM_USED to every open link, if a run is on: the next step is the first one with the parameters in
 * use. crc: theirs. */
void session_report_parameters(session_t *s, uint32_t crc);

/* Enter the ROM bootloader after the reply is out, unless a run begins or the board is armed before that. */
void session_ask_bootloader(session_t *s, uint32_t now_us);

/* End the run that the board has begun for a pilot, unless it is armed: a host asks for something that waits
 * for the end of a run. */
void session_end_alone(session_t *s, uint32_t now_us);

/* Send PLAUSIBILITY to one link. */
void session_send_readiness(session_t *s, link_t link);

#endif
