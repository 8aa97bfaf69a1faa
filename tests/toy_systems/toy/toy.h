/* A low-pass of one count, for tests. */
#ifndef PLUMB_SYSTEMS_TOY_H
#define PLUMB_SYSTEMS_TOY_H

#include "generated/records.h"
#include <stdbool.h>

typedef struct {
    toy_words_t words;
} toy_t;

/* All words become zero. */
void toy_init(toy_t *c, const control_params_t *p);

/* False for a value outside its range. */
bool toy_params_valid(const control_params_t *p);

/* One step. raw: the level, five unused; setpoint: counts Q16. */
void toy_step(toy_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX], int32_t setpoint);

#endif
