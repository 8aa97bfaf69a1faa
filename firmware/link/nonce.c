#include "nonce.h"

uint32_t nonce_issue(nonce_t *n, random_t *random, uint16_t verb, uint32_t asker, uint32_t now_us) {
    const uint32_t nonce = random_next(random);

    *n = (nonce_t){.value = nonce ^ asker, .asker = asker, .asked_us = now_us, .verb = verb, .valid = true};
    return nonce;
}

bool nonce_answer(nonce_t *n, uint16_t verb, uint32_t value, uint32_t now_us) {
    const bool good =
        n->valid && verb == n->verb && value == n->value && now_us - n->asked_us <= NONCE_LIFE_US;

    n->valid = false;
    return good;
}
