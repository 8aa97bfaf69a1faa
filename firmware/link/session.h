/* The conversation with the host: connect, parameters, run, telemetry, arming. PROTOCOL.md says what every
 * byte is.
 *
 * Bytes of the UART go in, bytes of the UART come out; time is an argument (us of the board's clock, wraps).
 * No hardware, no heap; the caller owns all memory. A turn of the main loop (firmware/main.c):
 *
 *     session_receive()      what came, at most session_receive_room()
 *     session_poll()         may disarm
 *     session_take_begin()   a run began: set the timer to session_period_us(), the outputs to its neutral
 *     per sample             from session_next_sample(), or live with session_setpoint(): control_step(),
 *                            actuate if session_driving(), session_stepped()
 *     session_transmit()     what there is to say
 *
 * Whenever session_driving() is false the outputs are at neutral.
 */
#ifndef PLUMB_LINK_SESSION_H
#define PLUMB_LINK_SESSION_H

#include "../board.h"
#include "../core/control.h"
#include "arming.h"
#include "outbox.h"
#include "params.h"
#include "slcan.h"

#define SESSION_QUEUE_LENGTH    16U /* samples in flight; a power of two */
#define SESSION_RECORD_WORDS    (sizeof(control_words_t) / 4U)
#define SESSION_WORD_BANKS      ((SESSION_RECORD_WORDS + 31U) / 32U)
#define SESSION_FAULTS_BLOCKING 0x00FFU /* of BOARD_FAULT_*: these disarm */

typedef enum { SESSION_IDLE = 0, SESSION_LOCKSTEP = 1, SESSION_REALTIME = 2 } session_mode_t;

/* One sample as injected, with the setpoint that goes with it. */
typedef struct {
    int16_t raw[CONTROL_RAW_MAX];
    int32_t setpoint_turn_q32;
} session_sample_t;

/* A reply of many frames, sent as the outbox has room: next of end. */
typedef struct {
    uint16_t next;
    uint16_t end;
} session_reply_t;

typedef struct {
    const board_identity_t *board;
    control_t *control;
    params_t *params; /* in use */
    params_t staged;  /* what a commit will make of them */
    slcan_rx_t rx;
    outbox_t outbox;
    arming_t arming;

    bool open;      /* between O or L and C */
    bool read_only; /* opened with L */
    bool greeted;   /* by a host of the same version and definitions */
    bool parameters_staged;
    uint8_t counter[OUTBOX_COUNTERS]; /* last received, 0xFF: none */
    uint16_t rejected;                /* received frames thrown away, modulo 2^16 */
    uint16_t lost;                    /* received frames missing by their counter, modulo 2^16 */
    session_reply_t identity;
    session_reply_t dump;
    uint32_t faults;
    uint32_t time_us;   /* last TIME */
    uint32_t status_us; /* last STATUS */

    session_mode_t mode;
    bool live;
    bool begun;                              /* not yet told to the main loop */
    bool stand_alone;                        /* this run was begun by the arm switch */
    uint32_t frames_mask;                    /* bank 0 of SELECT */
    uint32_t words_mask[SESSION_WORD_BANKS]; /* banks 1.. of SELECT */
    uint16_t selected;                       /* frames a step sends, STEP included */
    uint16_t step;                           /* number of the next step to run */
    uint16_t queue_in;     /* samples ever taken in; in lockstep the number of the next one */
    uint16_t queue_out;    /* samples ever taken out */
    uint16_t saturated;    /* steps with a clamped value, modulo 2^16 */
    uint16_t starved;      /* real-time steps without a new sample, modulo 2^16 */
    uint16_t dropped_told; /* outbox.dropped at the last STEP */
    uint16_t stale;    /* real-time steps since the last injected sample; all ones: none came in this run */
    uint8_t gap_ahead; /* how far ahead of the missing sample the last one was, 0xFF: none is missing */
    uint8_t sample_expected; /* real time: low six bits of the next sample's number */
    uint8_t raw_b_step6;     /* low six bits of the number raw_b belongs to, above 63: none */
    bool setpoint_waiting;   /* lockstep: given for the sample to come; real time: not yet used */
    int16_t raw_b[3];
    int32_t setpoint_turn_q32;
    session_sample_t held; /* the sample of the last step */
    session_sample_t queue[SESSION_QUEUE_LENGTH];
    uint32_t digest[SESSION_QUEUE_LENGTH]; /* of the last steps, to be sent again when a sample comes again */
} session_t;

/* Start from *params (valid; see params_default()) with the link closed, idle and disarmed. */
void session_init(session_t *s, const board_identity_t *board, control_t *control, params_t *params);

/* How many bytes session_receive() may be given now, so that every reply has room. 0 while the host does not
 * read. */
size_t session_receive_room(const session_t *s);

/* Take received bytes, at most session_receive_room(). */
void session_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* A frame, of whatever link: true when it is whole and may be taken, else it was counted as rejected. */
bool session_accepts(session_t *s, const can_frame_t *frame);

/* Do what an accepted frame asks for. */
void session_take_frame(session_t *s, const can_frame_t *frame, uint32_t now_us);

/* Take up to room bytes for the UART; returns how many. Order is kept, a frame may be split between two
 * calls. */
size_t session_transmit(session_t *s, uint8_t *out, size_t room);

/* Keep-alive, periodic telemetry, long replies. Call on every turn of the loop, at least once per
 * millisecond. */
void session_poll(session_t *s, uint32_t now_us);

/* True once after a run began (state, step number and digest are reset): set the timer to
 * session_period_us(). */
bool session_take_begin(session_t *s);

/* The next injected sample. Lockstep: false until one is waiting and its replies have room. Real time,
 * injected: true on every tick; without a new sample the last one is held and counted. */
bool session_next_sample(session_t *s, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint_turn_q32);

/* Setpoint of a live step. */
int32_t session_setpoint(const session_t *s);

/* After control_step(): sends the digest, and the words that were asked for. */
void session_stepped(session_t *s);

/* Board faults at this moment (BOARD_FAULT_*). With one of the low byte the next poll disarms. */
void session_report_faults(session_t *s, uint32_t faults);

/* The arm switch at this moment: closing it arms, opening it disarms (arming.h). Call on every turn of the
 * loop, after session_report_faults(). */
void session_report_switch(session_t *s, bool closed, uint32_t now_us);

bool session_armed(const session_t *s);
bool session_driving(const session_t *s); /* armed, and neutral was held long enough: the actuator may move */
bool session_live(const session_t *s);    /* real time with the board's own sensors */
session_mode_t session_mode(const session_t *s);
uint32_t session_period_us(const session_t *s);

#endif
