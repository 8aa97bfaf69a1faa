/* Random words for nonces, keep-alive values and run tags: xorshift32, stirred by the arrival times of
 * frames.
 *
 * They make old and foreign frames invalid. They protect against accidents, not against attackers, who can
 * predict the next word from the ones they receive. */
#ifndef PLUMB_LINK_RANDOM_H
#define PLUMB_LINK_RANDOM_H

#include <stdint.h>

typedef struct {
    uint32_t state; /* never 0 */
} random_t;

/* seed: should differ between boards and between starts. */
void random_init(random_t *r, uint32_t seed);

/* Mix in a value that the board does not choose: the arrival time of a frame, in us. */
void random_stir(random_t *r, uint32_t value);

/* The next word; never 0. */
uint32_t random_next(random_t *r);

#endif
