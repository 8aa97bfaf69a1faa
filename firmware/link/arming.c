#include "arming.h"

void arming_init(arming_t *a, uint32_t seed) {
    *a = (arming_t){0};
    a->random = seed | 1U;
}

uint32_t arming_challenge(arming_t *a, uint16_t verb, uint32_t now_us) {
    /* xorshift32: never 0 from a start that is not 0. The time goes in so that a restart does not repeat. */
    uint32_t x = a->random ^ now_us;

    if (x == 0) {
        x = 1;
    }
    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    a->random = x;
    a->nonce = x;
    a->nonce_verb = verb;
    a->nonce_us = now_us;
    a->nonce_valid = true;
    return x;
}

bool arming_answer(arming_t *a, uint16_t verb, uint32_t nonce, uint32_t now_us) {
    const bool good = a->nonce_valid && verb == a->nonce_verb && nonce == a->nonce &&
                      now_us - a->nonce_us <= ARMING_NONCE_US;

    a->nonce_valid = false;
    return good;
}

bool arming_arm(arming_t *a, uint16_t blocked, uint32_t token, uint32_t frame_us, uint32_t now_us) {
    if (blocked != 0) {
        return false;
    }
    a->armed = true;
    a->cause = 0;
    a->token = token;
    a->keepalive_us = now_us;
    a->silence_us = ARMING_SAFE_US - ARMING_TURN_US - frame_us;
    return true;
}

bool arming_keepalive(arming_t *a, uint32_t token, uint32_t now_us) {
    if (!a->armed || token != a->token) {
        return false;
    }
    /* A keep-alive that comes too late must not revive: the poll may not have run yet. */
    arming_poll(a, 0, now_us);
    a->keepalive_us = now_us;
    return a->armed;
}

void arming_disarm(arming_t *a, uint16_t cause) {
    if (a->armed) {
        a->armed = false;
        a->cause = cause;
    }
}

void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us) {
    if (blocked != 0) {
        arming_disarm(a, blocked);
    }
    if (now_us - a->keepalive_us > a->silence_us) {
        arming_disarm(a, ARMING_BLOCK_SILENCE);
    }
}
