/* Random words for nonces, keep-alive values and run tags: xorshift32, stirred by when frames arrive.
 *
 * They keep old and foreign frames from counting. They prevent accidents, not attackers: whoever hears one
 * can narrow down the next. */
#ifndef PLUMB_LINK_RANDOM_H
#define PLUMB_LINK_RANDOM_H

#include <stdint.h>

typedef struct {
    uint32_t state; /* never 0 */
} random_t;

/* seed: should differ between boards and between starts. */
void random_init(random_t *r, uint32_t seed);

/* Mix in something that the board does not decide: the time of a frame, in us. */
void random_stir(random_t *r, uint32_t value);

/* The next word; never 0. */
uint32_t random_next(random_t *r);

#endif
