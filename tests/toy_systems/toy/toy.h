/* A low-pass of one count, for tests. */
#ifndef PLUMB_SYSTEMS_TOY_H
#define PLUMB_SYSTEMS_TOY_H

#include "plumb/records.h"
#include <stdbool.h>

typedef struct {
    plumb_toy_words_t words;
} plumb_toy_t;

/* All words become zero. */
void plumb_toy_init(plumb_toy_t *c, const plumb_params_t *p);

/* False for a value outside its range. */
bool plumb_toy_params_valid(const plumb_params_t *p);

/* One step. raw: the level, five unused; setpoint: counts Q16. */
void plumb_toy_step(plumb_toy_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                    int32_t setpoint);

#endif
