/* One frequency taken out of a count. */
#ifndef PLUMB_SYSTEMS_NOTCH_H
#define PLUMB_SYSTEMS_NOTCH_H

#include "plumb/records.h"
#include <stdbool.h>

typedef struct {
    plumb_notch_words_t words;
    int32_t in[2];      /* counts of the last steps, the newest first */
    int32_t out_q12[2]; /* outputs of the last steps */
} plumb_notch_t;

/* Words and memory become zero. */
void plumb_notch_init(plumb_notch_t *c, const plumb_params_t *p);

/* False for a value outside its range. */
bool plumb_notch_params_valid(const plumb_params_t *p);

/* One step. raw: the count, five unused; the setpoint is not used. */
void plumb_notch_step(plumb_notch_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                      int32_t setpoint);

#endif
