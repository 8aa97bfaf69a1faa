/* The current of a motor, by a PI. */
#ifndef PLUMB_SYSTEMS_CURRENT_H
#define PLUMB_SYSTEMS_CURRENT_H

#include "plumb/records.h"
#include <stdbool.h>

typedef struct {
    plumb_current_words_t words;
} plumb_current_t;

/* All words become zero. */
void plumb_current_init(plumb_current_t *c, const plumb_params_t *p);

/* False for a value outside its range. */
bool plumb_current_params_valid(const plumb_params_t *p);

/* One step. raw: the count of the shunt's amplifier, five unused; setpoint: A Q20. */
void plumb_current_step(plumb_current_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                        int32_t setpoint_a_q20);

#endif
