/* Who may move the actuator: interlocks, nonce, keep-alive, latch.
 *
 * Armed is left on the first reason that blocks it, or when the keep-alive stays away, and never entered
 * again without a new arm command with a new nonce (latched). The outputs are to be safe 50 ms after the last
 * keep-alive: a neutral pulse begins with the next frame of pulses, so the limit is a frame and a turn of the
 * loop shorter. Time is an argument, in us of the board's clock; differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_ARMING_H
#define PLUMB_LINK_ARMING_H

#include <stdbool.h>
#include <stdint.h>

#define ARMING_SAFE_US  50000U   /* from the last keep-alive until the outputs are neutral, at most */
#define ARMING_TURN_US  1000U    /* of it for the loop to come round */
#define ARMING_NONCE_US 1000000U /* a nonce is good for this long, once */

/* Why arming is refused, or was left. Bits, as in STATUS. */
#define ARMING_BLOCK_HELLO    0x0001U /* no host with the same protocol version and message definitions */
#define ARMING_BLOCK_IDLE     0x0002U /* no run */
#define ARMING_BLOCK_LOCKSTEP 0x0004U /* the host paces the steps: not in real time */
#define ARMING_BLOCK_FAULT    0x0008U /* a board fault that blocks */
#define ARMING_BLOCK_CLOSED   0x0010U /* link closed or read-only */
#define ARMING_BLOCK_SILENCE  0x0020U /* left because the keep-alive was lost */
#define ARMING_BLOCK_COMMAND  0x0040U /* left because the host said so */
#define ARMING_BLOCK_SAMPLES  0x0080U /* injected in real time, and no sample came for a while */

typedef struct {
    bool armed;
    bool nonce_valid;
    uint16_t nonce_verb;
    uint16_t cause; /* ARMING_BLOCK_* that ended the last armed time; 0: none */
    uint32_t nonce;
    uint32_t nonce_us;
    uint32_t token; /* the nonce it was armed with: every keep-alive carries it */
    uint32_t keepalive_us;
    uint32_t silence_us; /* longest silence of who armed */
    uint32_t random;     /* xorshift state, never 0 */
} arming_t;

/* seed: anything that differs between boards. */
void arming_init(arming_t *a, uint32_t seed);

/* A fresh nonce for one command (verb); replaces the one before. Never 0. */
uint32_t arming_challenge(arming_t *a, uint16_t verb, uint32_t now_us);

/* True when this is the answer to the last challenge, in time. A nonce is used up by any answer, right or
 * wrong. */
bool arming_answer(arming_t *a, uint16_t verb, uint32_t nonce, uint32_t now_us);

/* Arm, unless blocked (ARMING_BLOCK_*) is not 0. token: what keep-alives will carry. frame_us: how long the
 * actuator takes to follow, below ARMING_SAFE_US - ARMING_TURN_US. */
bool arming_arm(arming_t *a, uint16_t blocked, uint32_t token, uint32_t frame_us, uint32_t now_us);

/* A keep-alive; one with a wrong token, or while disarmed, does nothing and returns false. */
bool arming_keepalive(arming_t *a, uint32_t token, uint32_t now_us);

/* Leave armed, for this cause; the first cause stays. */
void arming_disarm(arming_t *a, uint16_t cause);

/* To be called often: disarms when blocked is not 0 or the keep-alive is late. */
void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us);

#endif
