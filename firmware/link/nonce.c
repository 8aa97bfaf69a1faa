#include "nonce.h"

uint32_t nonce_issue(nonce_t *n, random_t *random, uint16_t verb, uint32_t now_us) {
    *n = (nonce_t){.value = random_next(random), .asked_us = now_us, .verb = verb, .valid = true};
    return n->value;
}

bool nonce_answer(nonce_t *n, uint16_t verb, uint32_t value, uint32_t now_us) {
    const bool good =
        n->valid && verb == n->verb && value == n->value && now_us - n->asked_us <= NONCE_LIFE_US;

    n->valid = false;
    return good;
}
