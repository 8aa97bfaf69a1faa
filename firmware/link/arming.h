/* Arming: decides whether the actuator may be driven.
 *
 * The board disarms when an interlock blocks (ARMING_BLOCK_*) or the keep-alive times out. It stays disarmed
 * (latched) until a host sends a new arm command with a fresh nonce, or the arm switch is opened and closed
 * again. The outputs must be safe 50 ms after the last keep-alive that counted (keepalive.h). A neutral pulse
 * begins with the next frame of pulses, so the time-out is shorter by one frame and one turn of the loop.
 * Time is an argument, in us of the board's clock; differences are taken modulo 2^32.
 *
 * The arm switch needs no host. Closing it arms, once it was seen open. It is also the dead man's handle: no
 * keep-alive is needed, and the first look that finds it open disarms. After any arming the actuator stays at
 * neutral for hold_us, so that speed controllers see their arming pulse; after that it is driving. */
#ifndef PLUMB_LINK_ARMING_H
#define PLUMB_LINK_ARMING_H

#include "keepalive.h"
#include <stdbool.h>
#include <stdint.h>

#define ARMING_SAFE_US 50000U /* from the last keep-alive until the outputs are neutral, at most */
#define ARMING_TURN_US 1000U  /* of it for the loop to come round */

#define ARMING_SWITCH_US     20000U  /* contacts bounce for some ms */
#define ARMING_SWITCH_TRY_US 100000U /* how long after closing what is in the way may still go away */
#define ARMING_SWITCH_READY_US                                                                               \
    5000000U /* and how long when all that is missing is NOT_READY: a run that has just begun is not */

/* Why the board refuses to arm, or why it disarmed. Bits, as in STATUS. */
#define ARMING_BLOCK_HELLO       0x0001U /* no host with the same protocol version and message definitions */
#define ARMING_BLOCK_IDLE        0x0002U /* no run */
#define ARMING_BLOCK_LOCKSTEP    0x0004U /* the host paces the steps: not in real time */
#define ARMING_BLOCK_FAULT       0x0008U /* a board fault that blocks */
#define ARMING_BLOCK_CLOSED      0x0010U /* link closed or read-only */
#define ARMING_BLOCK_SILENCE     0x0020U /* disarmed: the keep-alive timed out */
#define ARMING_BLOCK_COMMAND     0x0040U /* disarmed: a host sent DISARM or ended the run */
#define ARMING_BLOCK_SAMPLES     0x0080U /* injected in real time, and no sample came for a while */
#define ARMING_BLOCK_SWITCH      0x0100U /* disarmed: the arm switch was opened */
#define ARMING_BLOCK_PINS        0x0200U /* what the system moves is not on the pins the board started with */
#define ARMING_BLOCK_SWITCH_OWNS 0x0400U /* the arm switch is closed and owns arming */
#define ARMING_BLOCK_IMPLAUSIBLE                                                                             \
    0x0800U /* the sensors contradict each other or the system: PLAUSIBILITY says how */
#define ARMING_BLOCK_NOT_READY                                                                               \
    0x1000U /* not at rest, converged, level and without a setpoint: PLAUSIBILITY says what is missing */
#define ARMING_BLOCK_OWNER 0x2000U /* another link began the run, and alone may arm */
/* What concerns a host alone; the switch arms and stays armed all the same. */
#define ARMING_BLOCKS_HOST                                                                                   \
    (ARMING_BLOCK_HELLO | ARMING_BLOCK_CLOSED | ARMING_BLOCK_SWITCH_OWNS | ARMING_BLOCK_OWNER)

/* What the actuator needs to be safe, in us. */
typedef struct {
    uint32_t frame_us; /* how long it takes to follow, below ARMING_SAFE_US - ARMING_TURN_US */
    uint32_t hold_us;  /* neutral after arming, for this long */
} arming_actuator_t;

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
    bool by_switch;        /* who armed: the switch, else a host */
    uint16_t cause;        /* ARMING_BLOCK_* that ended the last armed time; 0: none */
    keepalive_t keepalive;
    uint32_t keepalive_us; /* the last one that counted */
    uint32_t silence_us;   /* keep-alive time-out */
    uint32_t armed_us;
    uint32_t hold_us;
    bool switch_closed;   /* at the last look */
    bool switch_ready;    /* was open long enough: the next closing counts */
    bool switch_trying;   /* closed, and waiting for what is in the way */
    bool switch_settling; /* at the last look nothing but ARMING_BLOCK_NOT_READY was in the way */
    uint32_t switch_us;   /* of its last change */
    uint32_t switch_try_us;
} arming_t;

void arming_init(arming_t *a);

bool arming_armed(const arming_t *a);
bool arming_driving(const arming_t *a); /* and armed */

/* Arm for a host; returns the first value for its keep-alive, or 0 when blocked (ARMING_BLOCK_*) is not 0. */
uint32_t arming_arm(arming_t *a, uint16_t blocked, arming_actuator_t actuator, random_t *random,
                    uint32_t now_us);

/* While a host has it armed: the next value for its keep-alive when one is due, else 0. */
uint32_t arming_issue(arming_t *a, random_t *random, uint32_t now_us);

/* The switch as it is now, closed or open; to be called often. True once for each closing that counts: held
 * for ARMING_SWITCH_US after being open as long, so one that was closed at the start has to be opened first.
 */
bool arming_switch(arming_t *a, bool closed, uint32_t now_us);

/* ARMING_BLOCK_SWITCH_OWNS while a closed switch keeps hosts from arming, else 0. */
uint16_t arming_switch_owns(const arming_t *a);

/* After a closing that counts: arms as soon as nothing but a host is missing, for ARMING_SWITCH_TRY_US, or
 * for ARMING_SWITCH_READY_US while nothing but ARMING_BLOCK_NOT_READY is in the way; then the switch has to
 * be opened first. */
void arming_try_switch(arming_t *a, uint16_t blocked, arming_actuator_t actuator, uint32_t now_us);

/* A keep-alive; one that does not count, or comes while disarmed, does nothing and returns false. */
bool arming_keepalive(arming_t *a, uint32_t value, uint32_t now_us);

/* Disarm, for this cause; the first cause stays. */
void arming_disarm(arming_t *a, uint16_t cause);

/* As arming_disarm, but only when a host armed: a lost link does not disarm what the switch armed. */
void arming_disarm_host(arming_t *a, uint16_t cause);

/* To be called often: disarms when blocked is not 0 or the keep-alive is late; ends the hold. */
void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us);

#endif
