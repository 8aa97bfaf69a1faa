/* The attitudes of `turntable`: one for both sensors, or in the attitude layer one of each. */
#ifndef PLUMB_SYSTEMS_TURNTABLE_ATTITUDE_H
#define PLUMB_SYSTEMS_TURNTABLE_ATTITUDE_H

#include "turntable_rate.h"

/* Merge the two attitudes into one. */
PART void plumb_turntable_merge_attitudes(plumb_turntable_words_t *w);

/* Propagate both attitudes by one step. */
PART void plumb_turntable_propagate_attitude(plumb_turntable_words_t *w, const plumb_fusion_params_t *f,
                                             turntable_step_t *s);

#endif
