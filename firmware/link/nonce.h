/* Nonce: permits one command that changes state, on one link. It is valid once, for the verb it was requested
 * for, within NONCE_LIFE_US, for the host that asked: on a bus others receive the nonce, too, and may take it
 * for the answer to their own question. Time is an argument, in us of the board's clock; differences are
 * taken modulo 2^32. */
#ifndef PLUMB_LINK_NONCE_H
#define PLUMB_LINK_NONCE_H

#include "random.h"
#include <stdbool.h>

#define NONCE_LIFE_US 1000000U

typedef struct {
    uint32_t value; /* what answers it: the nonce, XORed with asker */
    uint32_t asker;
    uint32_t asked_us;
    uint16_t verb;
    bool valid;
} nonce_t;

/* Issue a new nonce for this verb, never 0; it replaces the previous one. asker: a number that the host has
 * chosen; 0: none. */
uint32_t nonce_issue(nonce_t *n, random_t *random, uint16_t verb, uint32_t asker, uint32_t now_us);

/* True when verb and value match the last nonce, the value XORed with its asker, within NONCE_LIFE_US. Any
 * answer, right or wrong, uses the nonce up. */
bool nonce_answer(nonce_t *n, uint16_t verb, uint32_t value, uint32_t now_us);

#endif
