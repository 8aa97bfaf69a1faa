#include "keepalive.h"

/* Index of this value among the kept ones; KEEPALIVE_KEPT when it is not there. */
static unsigned find(const keepalive_t *k, uint32_t value) {
    unsigned at = 0;

    while (at < KEEPALIVE_KEPT && k->value[at] != value) {
        at++;
    }
    return at;
}

static uint32_t issue(keepalive_t *k, random_t *random, uint32_t now_us) {
    uint32_t value = random_next(random);

    while (find(k, value) < KEEPALIVE_KEPT) {
        value = random_next(random);
    }
    k->value[k->next] = value;
    k->issued_us[k->next] = now_us;
    k->next = (uint8_t)((k->next + 1U) % KEEPALIVE_KEPT);
    return value;
}

void keepalive_begin(keepalive_t *k, uint32_t now_us) {
    *k = (keepalive_t){.last_us = now_us - KEEPALIVE_PERIOD_US};
}

uint32_t keepalive_issue(keepalive_t *k, random_t *random, uint32_t now_us) {
    const uint32_t since_us = now_us - k->last_us;

    if (since_us < KEEPALIVE_PERIOD_US) {
        return 0U;
    }
    /* Keep to multiples of the period; after a gap, count the period from now. */
    k->last_us = since_us < 2U * KEEPALIVE_PERIOD_US ? k->last_us + KEEPALIVE_PERIOD_US : now_us;
    return issue(k, random, now_us);
}

bool keepalive_counts(keepalive_t *k, uint32_t value, uint32_t now_us) {
    const unsigned at = value != 0U ? find(k, value) : KEEPALIVE_KEPT;

    if (at == KEEPALIVE_KEPT || now_us - k->issued_us[at] > KEEPALIVE_LIFE_US) {
        return false;
    }
    k->value[at] = 0U;
    return true;
}
