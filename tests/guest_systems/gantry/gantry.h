/* Three slides, each after its own setpoint. */
#ifndef PLUMB_SYSTEMS_GANTRY_H
#define PLUMB_SYSTEMS_GANTRY_H

#include "plumb/records.h"
#include <stdbool.h>

typedef struct {
    plumb_gantry_words_t words;
} plumb_gantry_t;

/* All words become zero. */
void plumb_gantry_init(plumb_gantry_t *c, const plumb_params_t *p);

/* False for a value outside its range. */
bool plumb_gantry_params_valid(const plumb_params_t *p);

/* One step. raw: three encoders, three unused, then the setpoints of the second slide and of the third, its
 * low half first; setpoint_x_counts: of the first. */
void plumb_gantry_step(plumb_gantry_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                       int32_t setpoint_x_counts);

#endif
