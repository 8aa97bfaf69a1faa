/* Arming: decides whether the actuator may be driven.
 *
 * The board disarms when an interlock blocks (ARMING_BLOCK_*) or the keep-alive times out. It stays disarmed
 * (latched) until a host sends a new arm command with a fresh nonce, or the arm switch is opened and closed
 * again. The outputs must be safe 50 ms after the last keep-alive that counted (keepalive.h). The time-out
 * leaves enough of these 50 ms for all other delays, also on the slower of the board's oscillators:
 * docs/reference/protocol.md adds them up.
 * Time is an argument, in us of the board's clock; differences are taken modulo 2^32.
 *
 * Each arming has a number, which the ACK of ARM tells the host and every keep-alive value carries. Only
 * keep-alives with the number of the present arming count: a host whose arming is over holds nothing.
 *
 * The arm switch needs no host. Closing it arms the board, once it was seen open. It is also the dead man's
 * switch: no keep-alive is needed, and the board disarms as soon as the switch reads open. After arming by
 * either way the actuator stays at neutral for hold_us, so that speed controllers see their arming pulse;
 * then it is driven.
 *
 * An image without a system that drives something never arms, and its arm switch does nothing: its build
 * takes arming_none.c. */
#ifndef PLUMB_LINK_ARMING_H
#define PLUMB_LINK_ARMING_H

#include "keepalive.h"
#include <stdbool.h>
#include <stdint.h>

#define ARMING_SAFE_US 50000U /* from the last keep-alive until the outputs are neutral, at most */
/* Keep-alive time-out: three values in a row may be lost, which is a gap of 40 ms. */
#define ARMING_SILENCE_US 43000U
#define ARMING_TURN_US    1500U /* a turn of the loop: 1 ms of sleep, and its work */

#define ARMING_SWITCH_US     20000U  /* contacts bounce for some ms */
#define ARMING_SWITCH_TRY_US 100000U /* after closing the switch: limit for blocking reasons to clear */
/* The same while ARMING_BLOCK_NOT_READY is the only reason: a run that the switch began is not ready. */
#define ARMING_SWITCH_READY_US 5000000U

/* Why the board refuses to arm, or why it disarmed. Bits, as in STATUS. */
#define ARMING_BLOCK_HELLO       0x0001U /* no host with the same protocol version and message definitions */
#define ARMING_BLOCK_IDLE        0x0002U /* no run */
#define ARMING_BLOCK_LOCKSTEP    0x0004U /* the run is in lockstep, not in real time */
#define ARMING_BLOCK_FAULT       0x0008U /* a board fault that blocks */
#define ARMING_BLOCK_CLOSED      0x0010U /* link closed or read-only */
#define ARMING_BLOCK_SILENCE     0x0020U /* disarmed: the keep-alive timed out */
#define ARMING_BLOCK_COMMAND     0x0040U /* disarmed: a host sent DISARM or ended the run */
#define ARMING_BLOCK_SAMPLES     0x0080U /* no new injected samples come, or too many are lost */
#define ARMING_BLOCK_SWITCH      0x0100U /* disarmed: the arm switch was opened */
#define ARMING_BLOCK_PINS        0x0200U /* the board's pin set does not have the system's actuator */
#define ARMING_BLOCK_SWITCH_OWNS 0x0400U /* the arm switch is closed and owns arming */
#define ARMING_BLOCK_IMPLAUSIBLE                                                                             \
    0x0800U /* the sensors contradict each other or the system: PLAUSIBILITY says how */
#define ARMING_BLOCK_NOT_READY                                                                               \
    0x1000U /* not at rest, converged, level and without a setpoint: PLAUSIBILITY says what is missing */
#define ARMING_BLOCK_OWNER 0x2000U /* another link began the run, and alone may arm */
#define ARMING_BLOCK_PARAMETER                                                                               \
    0x4000U /* with the parameters in use an armed board would break a promise: staging_unsafe() */
#define ARMING_BLOCK_STOPPED 0x8000U /* the step has stopped the motors: PLAUSIBILITY says why */
/* Reasons that concern hosts only: they neither keep the switch from arming nor disarm it. */
#define ARMING_BLOCKS_HOST                                                                                   \
    (ARMING_BLOCK_HELLO | ARMING_BLOCK_CLOSED | ARMING_BLOCK_SWITCH_OWNS | ARMING_BLOCK_OWNER)

/* A flag of 32 bits. One value means yes and every other one no, so a flipped bit cannot turn a no into a
 * yes. */
typedef struct {
    uint32_t word;
} arming_word_t;

#define ARMING_ARMED   0x6b95d2a7U
#define ARMING_DRIVING 0xd14e783bU

typedef struct {
    arming_word_t armed;   /* ARMING_ARMED */
    arming_word_t driving; /* ARMING_DRIVING: armed, and the hold is over */
    bool by_switch;        /* armed by the switch; false: by a host */
    uint16_t cause;        /* ARMING_BLOCK_* of the last disarming; 0: none */
    uint16_t number;       /* of the last arming, counting up over disarming, never 0 */
    keepalive_t keepalive;
    uint32_t keepalive_us; /* the last one that counted */
    uint32_t armed_us;
    uint32_t hold_us;       /* the outputs stay at neutral for this long after arming */
    bool switch_closed;     /* at the last reading */
    bool switch_ready;      /* was open long enough: the next closing counts */
    bool switch_trying;     /* closed, and waiting for the blocking reasons to clear */
    bool switch_settling;   /* ARMING_BLOCK_NOT_READY was the only reason at the last try */
    uint32_t switch_us;     /* when it last changed */
    uint32_t switch_try_us; /* when switch_trying began */
} arming_t;

/* random: number before that of the first arming, so that a board after a reset does not repeat its numbers.
 */
void arming_init(arming_t *a, uint32_t random);

bool arming_armed(const arming_t *a);
bool arming_driving(const arming_t *a); /* armed, and the hold at neutral is over */

/* Arm for a host, with the next number; the first value for its keep-alive is due at once. False, with no
 * effect, when blocked (ARMING_BLOCK_*) is not 0. */
bool arming_arm(arming_t *a, uint16_t blocked, uint32_t hold_us, uint32_t now_us);

/* Next value for the keep-alive of the host that armed, when one is due; else 0. */
uint32_t arming_issue(arming_t *a, random_t *random, uint32_t now_us);

/* Feed the reading of the switch, or of a pilot's; call on every whole turn of the loop. True once for each
 * closing that counts: closed for ARMING_SWITCH_US after being open for as long. A switch that is closed at
 * the start has to be opened first. */
bool arming_switch(arming_t *a, bool closed, uint32_t now_us);

/* The switch cannot be read, or another one is read from now on: it has to be seen open once more before a
 * closing counts. A board that is armed stays so. */
void arming_switch_unread(arming_t *a);

/* True while a closed switch waits to be opened, because its closing was used up or never counted. */
bool arming_switch_used_up(const arming_t *a);

/* ARMING_BLOCK_SWITCH_OWNS while a closed switch keeps hosts from arming, else 0. */
uint16_t arming_switch_owns(const arming_t *a);

/* Call while switch_trying: arms as soon as no reason but ARMING_BLOCKS_HOST is left. Gives up after
 * ARMING_SWITCH_TRY_US, or ready_us while ARMING_BLOCK_NOT_READY is the only reason; then the switch has to
 * be opened first. */
void arming_try_switch(arming_t *a, uint16_t blocked, uint32_t ready_us, uint32_t hold_us, uint32_t now_us);

/* Handle a keep-alive. False, with no effect on the arming, when it is of another arming, when the value does
 * not count, when it comes too late (arming_poll() then disarms) or the board is disarmed. */
bool arming_keepalive(arming_t *a, uint16_t number, uint32_t value, uint32_t now_us);

/* Disarm for this cause; a board that is disarmed already keeps its first cause. */
void arming_disarm(arming_t *a, uint16_t cause);

/* As arming_disarm(), but only when a host armed: a lost link does not disarm a board armed by the switch. */
void arming_disarm_host(arming_t *a, uint16_t cause);

/* Call on every whole turn of the loop: disarms when blocked is not 0 or the keep-alive is late; ends the
 * hold. */
void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us);

/* How long the next arming_poll() and arming_issue() may wait while the board is armed: until a value is due,
 * the keep-alive is late, or the hold is over; UINT32_MAX when nothing is due. */
uint32_t arming_within_us(const arming_t *a, uint32_t now_us);

#endif
