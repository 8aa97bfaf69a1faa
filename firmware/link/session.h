/* The conversation with the host: connect, parameters, run, telemetry, arming. PROTOCOL.md says what every byte is.
 *
 * Bytes of the UART go in, bytes of the UART come out; time is an argument (us of the board's clock, wraps). No
 * hardware, no heap; the caller owns all memory. The main loop:
 *
 *     n = board_uart_read(buffer, min(sizeof buffer, session_receive_room(&s)));
 *     session_receive(&s, buffer, n, now);
 *     session_poll(&s, now);
 *     if (session_take_begin(&s)) { program the period and neutral; }
 *     lockstep:            due = session_next_sample(&s, raw, &setpoint);
 *     real time, injected: due = board_take_tick() && session_next_sample(&s, raw, &setpoint);
 *     real time, live:     due = board_take_tick() && board_read_sensors(raw); setpoint = session_setpoint(&s);
 *     if (due) { control_step(...); actuate if session_armed(&s), else neutral; session_stepped(&s, now); }
 *     n = session_transmit(&s, buffer, room); board_uart_write(buffer, n);
 *     without a step due, and whenever !session_armed(&s): the actuator is neutral
 */
#ifndef PLUMB_LINK_SESSION_H
#define PLUMB_LINK_SESSION_H

#include "../core/control.h"
#include "arming.h"
#include "e2e.h"
#include "params.h"
#include "slcan.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SESSION_QUEUE_LENGTH 16U   /* lockstep samples in flight */
#define SESSION_TX_BYTES     2048U /* power of two */
#define SESSION_TX_RESERVE   512U  /* kept free of telemetry, so that replies always fit */

typedef enum { SESSION_IDLE = 0, SESSION_LOCKSTEP = 1, SESSION_REALTIME = 2 } session_mode_t;

/* Board faults, reported with session_report_faults(). The low byte blocks arming, the high byte only informs. */
#define SESSION_FAULT_ADC            0x0001U /* no conversions, or calibration did not end */
#define SESSION_FAULT_LATE           0x0002U /* control steps were missed: the loop is too slow for period_us */
#define SESSION_FAULT_HARD           0x0004U /* the last reset came from the fault handler */
#define SESSION_FAULT_CLOCK_FALLBACK 0x0100U /* crystal absent or failed: running from the internal oscillator */
#define SESSION_FAULT_UART_OVERRUN   0x0200U /* received bytes were lost */
#define SESSION_FAULT_WATCHDOG       0x0400U /* the last reset came from the watchdog */

/* What the board is; the session only passes it on. */
typedef struct {
    uint32_t part_id;      /* device id register */
    uint32_t unique_id[3]; /* 96 bits */
    uint32_t git_hash[2];  /* first 16 hexadecimal digits of the commit, most significant first; 0: not known */
    uint32_t flash_kib;
    uint32_t ram_kib;
    uint32_t reset_cause; /* reset flags as the part shows them */
} session_config_t;

/* One sample as injected, with the setpoint that goes with it. */
typedef struct {
    int16_t raw[CONTROL_RAW_MAX];
    int32_t setpoint_turn_q32;
} session_sample_t;

typedef struct {
    const session_config_t *config;
    control_t *control;
    params_t *params;
    params_t staged; /* what commit will make of *params */
    slcan_rx_t rx;
    arming_t arming;
    uint8_t tx[SESSION_TX_BYTES];
    session_sample_t queue[SESSION_QUEUE_LENGTH];
} session_t;

/* Start from *params (valid; defaults: params_default()) with the link closed, idle and disarmed. */
void session_init(session_t *s, const session_config_t *config, control_t *control, params_t *params);

/* How many bytes session_receive() may be given now, so that every reply has room. 0 while the host does not read. */
size_t session_receive_room(const session_t *s);

/* Take received bytes, at most session_receive_room(). */
void session_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* Take up to room bytes for the UART; returns how many. Order is kept, a frame may be split between two calls. */
size_t session_transmit(session_t *s, uint8_t *out, size_t room);

/* Keep-alive, periodic telemetry, long replies. Call on every turn of the loop, at least once per millisecond. */
void session_poll(session_t *s, uint32_t now_us);

/* True once after a run began (state, step number and digest are reset): set the timer to session_period_us(). */
bool session_take_begin(session_t *s);

/* The next injected sample. Lockstep: false until one is waiting and its replies have room. Real time, injected:
 * true on every tick; without a new sample the last one is held and counted. */
bool session_next_sample(session_t *s, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint_turn_q32);

/* Setpoint of a live step. */
int32_t session_setpoint(session_t *s);

/* After control_step(): sends the digest, and the words that were asked for. */
void session_stepped(session_t *s, uint32_t now_us);

/* Board faults at this moment (SESSION_FAULT_*). A new one of the low byte disarms. */
void session_report_faults(session_t *s, uint32_t faults);

bool session_armed(const session_t *s);
bool session_live(const session_t *s); /* real time with the board's own sensors */
session_mode_t session_mode(const session_t *s);
uint32_t session_period_us(const session_t *s);

#endif
