/* The conversation with the host: connect, parameters, run, telemetry, arming. PROTOCOL.md says what every
 * byte is.
 *
 * Two links, which may both be open: bytes of the UART and frames of CAN go in and come out; time is an
 * argument (us of the board's clock, wraps). No hardware, no heap; the caller owns all memory. A turn of the
 * main loop (firmware/app/loop.c):
 *
 *     session_receive()      what the UART brought, at most session_receive_room()
 *     session_receive_frame()  what CAN brought, while session_frame_room()
 *     session_poll()         may disarm
 *     session_take_begin()   a run began: set the timer to session_period_us(), the outputs to its neutral
 *     per sample             from session_next_sample(), or live with session_setpoint(): control_step(),
 *                            actuate if session_driving(), session_stepped()
 *     session_transmit()     what there is to say on the UART, session_transmit_frame() on CAN
 *
 * Whenever session_driving() is false the outputs are at neutral.
 */
#ifndef PLUMB_LINK_SESSION_H
#define PLUMB_LINK_SESSION_H

#include "app/board.h"
#include "app/board_links.h"
#include "app/board_sensors.h"
#include "arming.h"
#include "nonce.h"
#include "outbox.h"
#include "params.h"
#include "slcan.h"
#include "store.h"
#include "systems/control.h"

#define SESSION_QUEUE_LENGTH    16U /* samples in flight; a power of two */
#define SESSION_SLOT(step)      ((step) & (SESSION_QUEUE_LENGTH - 1U))
#define SESSION_WORD_BANKS      ((CONTROL_RECORD_WORDS_MAX + 31U) / 32U)
#define SESSION_FAULTS_BLOCKING 0xE0FFU /* of BOARD_FAULT_*: these disarm */

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

typedef enum { LINK_UART = 0, LINK_CAN = 1, LINKS = 2, LINK_NONE = LINKS } link_t;

/* One way to a host. */
typedef struct {
    outbox_t *outbox;
    bool open;             /* UART: between O or L and C; CAN: from HELLO to CLOSE or silence */
    bool read_only;        /* opened with L */
    bool greeted;          /* by a host of the same version and definitions */
    uint8_t *counter;      /* OUTBOX_COUNTERS of them: last received, 0xFF: none */
    uint16_t rejected;     /* received frames thrown away, modulo 2^16 */
    uint16_t lost;         /* received frames missing by their counter, modulo 2^16 */
    uint16_t dropped_told; /* outbox.dropped at the last STEP */
    uint32_t heard_us;     /* last good frame */
    uint32_t long_us;      /* last frame of a long reply */
    nonce_t nonce;         /* the one that was asked for here: answered here or nowhere */
    session_reply_t identity;
    session_reply_t dump;
} session_link_t;

/* What passes through: frames, samples and digests that wait, parameters that are not in use yet. It decides
 * no pulse: frames carry their CRC, a table is committed by its own. */
typedef struct {
    outbox_t outbox[LINKS];
    uint8_t counter[LINKS][OUTBOX_COUNTERS];
    slcan_rx_t rx;
    params_t staged; /* what a commit will make of those in use */
    session_sample_t queue[SESSION_QUEUE_LENGTH];
    uint32_t digest[SESSION_QUEUE_LENGTH]; /* of the last steps, to be sent again when a sample comes again */
} session_buffers_t;

/* All of it decides whether and how something moves: the board keeps a check word over it
 * (board_memory_seal()). What is large and decides nothing belongs into the buffers. */
typedef struct {
    const board_identity_t *board;
    control_t *control;
    params_t *params; /* in use */
    session_buffers_t *buffers;
    session_link_t link[LINKS];
    arming_t arming;
    random_t random;

    link_t asked;           /* over which the request at hand came */
    link_t run_owner;       /* which began the run: it alone may arm, its keep-alive holds it armed, and
                               lockstep goes at its pace. LINK_NONE: the arm switch began it */
    link_t sample_source;   /* which alone may send this run's samples */
    link_t setpoint_source; /* which alone may send this run's setpoints */
    uint8_t run_tag;        /* 1 to 15, of the run that is on or was last: its setpoints carry it */
    link_t staged_by;       /* while parameters are staged */
    bool parameters_staged;
    store_report_t saved;     /* what flash holds */
    uint16_t parameters_from; /* store_found_t or REQUESTS_FROM_HOST */
    bool bootloader_asked;
    uint32_t bootloader_us; /* when */
    uint32_t faults;
    const board_can_health_t *can;
    uint32_t can_kbit;
    board_health_t health;
    plausibility_t plausibility;
    uint16_t disarmed_by_checks; /* PLAUSIBILITY_ACCEL and so on: what failed when it was armed last */
    uint32_t time_us;            /* last TIME */
    uint32_t status_us;          /* last STATUS */

    session_mode_t mode;
    bool live;
    bool begun;                              /* not yet told to the main loop */
    bool stand_alone;                        /* this run was begun by the arm switch */
    uint32_t frames_mask;                    /* bank 0 of SELECT */
    uint32_t words_mask[SESSION_WORD_BANKS]; /* banks 1.. of SELECT */
    uint16_t selected;     /* frames a step sends at once, STEP included; the words follow */
    uint16_t step;         /* number of the next step to run */
    uint16_t step_seen;    /* at the last look of an armed board, */
    uint32_t step_seen_us; /* and when it was new */
    uint16_t queue_in;     /* samples ever taken in; in lockstep the number of the next one */
    uint16_t queue_out;    /* samples ever taken out */
    uint16_t saturated;    /* steps with a clamped value, modulo 2^16 */
    uint16_t starved;      /* real-time steps without a new sample, modulo 2^16 */
    uint16_t
        word_next; /* of the last step's record, the next to be sent; CONTROL_RECORD_WORDS_MAX: all were */
    uint32_t sample_us; /* arrival of the last injected sample */
    uint16_t stale; /* real-time steps since the last injected sample; all ones: none came in this run, or its
                       source has ceased */
    uint8_t gap_ahead;       /* how far ahead of the missing sample the last one was, 0xFF: none is missing */
    uint8_t sample_expected; /* real time: low six bits of the next sample's number, above 63: any */
    uint8_t raw_b_step6;     /* low six bits of the number raw_b belongs to, above 63: none */
    bool setpoint_waiting;   /* lockstep: given for the sample to come; real time: not yet used */
    int16_t raw_b[3];
    bool setpoint_heard;     /* since the last poll */
    bool setpoint_timed_out; /* set to 0 because its source fell silent, and not yet told */
    uint32_t setpoint_us;    /* when the source was heard last, or nothing moved */
    int32_t setpoint_turn_q32;
    int32_t setpoint_told_turn_q32; /* by the last SETPOINT_USED */
    session_sample_t held;          /* the sample of the last step */
} session_t;

/* Start from *params (valid; see params_default()) with both links closed, idle and disarmed. */
void session_init(session_t *s, session_buffers_t *buffers, const board_identity_t *board, control_t *control,
                  params_t *params);

/* The memory of *s was damaged: no value in it counts, but for which links are open, so that their hosts are
 * told; the UART's counts as open. As session_init(), disarmed by a fault; what waits to be sent is sent. */
void session_recover(session_t *s, session_buffers_t *buffers, const board_identity_t *board,
                     control_t *control, params_t *params);

/* How many bytes session_receive() may be given now, so that every reply has room. 0 while the host does not
 * read. */
size_t session_receive_room(const session_t *s);

/* Take received bytes of the UART, at most session_receive_room(). */
void session_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* True when a frame of CAN may be taken: its reply has room. */
bool session_frame_room(const session_t *s);

/* Take a frame of CAN. */
void session_receive_frame(session_t *s, const can_frame_t *frame, uint32_t now_us);

/* Do what a frame asks for that was accepted from this link. */
void session_take_frame(session_t *s, link_t link, const can_frame_t *frame, uint32_t now_us);

/* Take up to room bytes for the UART; returns how many. Order is kept, a frame may be split between two
 * calls. */
size_t session_transmit(session_t *s, uint8_t *out, size_t room);

bool session_frame_waits(const session_t *s);

/* Take the next frame for CAN; false when none waits. */
bool session_transmit_frame(session_t *s, can_frame_t *frame);

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

/* Board faults at this moment (BOARD_FAULT_*). With one of SESSION_FAULTS_BLOCKING the next poll disarms. */
void session_report_faults(session_t *s, uint32_t faults);

/* How the CAN controller fares: sent with the status. Kept by the caller. */
void session_report_can(session_t *s, const board_can_health_t *health);

/* Bit rate for CAN: the parameter, but never another one while a host is there. */
uint32_t session_can_kbit(const session_t *s);

/* The arm switch at this moment: closing it arms, opening it disarms (arming.h). Call on every turn of the
 * loop, after session_report_faults(). */
void session_report_switch(session_t *s, bool closed, uint32_t now_us);

/* Staged parameters become those in use. No run is on. */
void session_use_staged(session_t *s);

/* What stands behind BOARD_FAULT_SENSOR at this moment, for SENSORS. */
void session_report_sensors(session_t *s, const board_health_t *health);

bool session_armed(const session_t *s);
bool session_driving(const session_t *s); /* armed, and neutral was held long enough: the actuator may move */
bool session_live(const session_t *s);    /* real time with the board's own sensors */
session_mode_t session_mode(const session_t *s);
uint32_t session_period_us(const session_t *s);

#endif
