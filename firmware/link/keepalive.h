/* Keep-alive of the host that armed: the board issues values, the host sends each back once.
 *
 * A value counts once, within KEEPALIVE_LIFE_US after it was issued. So a recorded or repeated frame does not
 * count, nor does one that was stuck in a buffer for longer. Time is an argument, in us of the board's clock;
 * differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_KEEPALIVE_H
#define PLUMB_LINK_KEEPALIVE_H

#include "random.h"
#include <stdbool.h>

#define KEEPALIVE_PERIOD_US 10000U
#define KEEPALIVE_LIFE_US   40000U
#define KEEPALIVE_KEPT      (KEEPALIVE_LIFE_US / KEEPALIVE_PERIOD_US + 1U) /* values that may still count */

typedef struct {
    uint32_t value[KEEPALIVE_KEPT]; /* 0: none, or used */
    uint32_t issued_us[KEEPALIVE_KEPT];
    uint32_t last_us; /* when the last value was due */
    uint8_t next;     /* index of the next value */
} keepalive_t;

/* Forget all values; the first is due at once. */
void keepalive_begin(keepalive_t *k, uint32_t now_us);

/* The next value, once every KEEPALIVE_PERIOD_US, never 0; 0 while it is not due. */
uint32_t keepalive_issue(keepalive_t *k, random_t *random, uint32_t now_us);

/* True when this value was issued, is unused and not too old; marks it as used. */
bool keepalive_counts(keepalive_t *k, uint32_t value, uint32_t now_us);

#endif
