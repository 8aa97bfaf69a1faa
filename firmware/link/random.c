#include "random.h"

#define SPREAD 0x9E3779B1U /* 2^32 divided by the golden ratio, odd: neighbouring seeds end up far apart */

void random_init(random_t *r, uint32_t seed) {
    r->state = seed * SPREAD | 1U;
}

void random_stir(random_t *r, uint32_t value) {
    r->state ^= value;
    (void)random_next(r);
}

uint32_t random_next(random_t *r) {
    uint32_t x = r->state != 0U ? r->state : SPREAD;

    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    r->state = x;
    return x;
}
