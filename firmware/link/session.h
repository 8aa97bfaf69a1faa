/* Session: everything between the links and the control step, composed from the modules below.
 *
 * Each module owns one part of the state: a struct that only the file of the same name writes. Calls go
 * downwards only: requests.c and what it calls for the requests of a host (execution.c, run_requests.c,
 * table_requests.c) call the session, the session calls the modules, and no module knows the session.
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
 * 2^32. A whole turn of the main loop (firmware/app/loop.c):
 *
 *     requests_receive()        bytes of the UART, at most requests_room()
 *     requests_receive_frame()  frames of CAN, while requests_frame_room()
 *     session_receive_pilot()   lines of the receiver
 *     session_report()          the state of the board
 *     session_poll()            may disarm
 *     session_take_orders()     orders to the board
 *     per sample                session_take_inputs(), control_step(), actuate if driving, session_stepped()
 *     session_turn_within_us()  when the next one is due
 *     session_transmit()        text for the UART; session_transmit_frame() for CAN
 *
 * Unless the orders say driving, the outputs are at neutral. */
#ifndef PLUMB_LINK_SESSION_H
#define PLUMB_LINK_SESSION_H

#include "session_state.h"

#define SESSION_LOCKSTEP_US 1000U /* between two whole turns; the tick of 1 ms may add almost 1 ms */
#define SESSION_ARMED_US    2600U /* the same: more than a step of 400 Hz */

/* State of the board in a turn of the loop. */
typedef struct {
    uint32_t faults;    /* BOARD_FAULT_*; with one of SESSION_FAULTS_BLOCKING the next poll disarms */
    bool switch_closed; /* the arm switch: closing it arms, opening it disarms (arming.h) */
    const board_can_health_t *can; /* sent with the status; the caller keeps it */
    board_health_t sensors;        /* the details of BOARD_FAULT_SENSOR, sent as SENSORS */
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

/* Pass the state of the board to the session. Call on every whole turn. */
void session_report(session_t *s, const session_report_t *report, uint32_t now_us);

/* Keep-alive, periodic telemetry, long replies. Call on every whole turn of the loop after session_report():
 * once per millisecond, or as session_turn_within_us() says. */
void session_poll(session_t *s, uint32_t now_us);

/* The orders to the board, until the next poll. */
session_orders_t session_take_orders(session_t *s, uint32_t now_us);

/* How long the next turn may wait, when neither a step is due nor input comes nor the arm switch moves:
 * SESSION_LOCKSTEP_US in lockstep; while armed up to SESSION_ARMED_US, or until the first time-out; else, and
 * while something waits for room in an outbox, 0: every turn is a whole one. Call at the end of a turn. */
uint32_t session_turn_within_us(const session_t *s, uint32_t now_us);

/* Remove up to room bytes for the UART; returns how many. Order is kept, a frame may be split between two
 * calls. Reads nothing of the state, whose memory a short turn has not checked. */
size_t session_transmit(session_buffers_t *buffers, uint8_t *out, size_t room);

/* Remove the next frame for CAN; false when none waits. */
bool session_transmit_frame(session_buffers_t *buffers, can_frame_t *frame);

/* ---- for the requests of a host, whose nonce and permission have been checked ---- */

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

#endif
