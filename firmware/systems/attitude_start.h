/* How the filter of `attitude` starts, at once or again. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_START_H
#define PLUMB_SYSTEMS_ATTITUDE_START_H

#include "attitude_limits.h"

/* Clears the sums at the start of a block. */
PART void plumb_attitude_clear_sums(plumb_attitude_t *c);

/* Forgets the velocity, and how well the errors are known: their variances become those of a start, of bias
 * and tilt these. */
SELDOM PART void plumb_attitude_forget(plumb_attitude_t *c, const plumb_attitude_params_t *a, int32_t bias,
                                       int32_t tilt);

/* Restarts the filter as before the first sample; the heading stays. */
SELDOM PART void plumb_attitude_start(plumb_attitude_t *c, const plumb_attitude_params_t *a);

#endif
