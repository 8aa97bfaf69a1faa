/* What `attitude` thinks of its own estimate once a block. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_JUDGE_H
#define PLUMB_SYSTEMS_ATTITUDE_JUDGE_H

#include "attitude_limits.h"

#define LONG_RESTS 7U /* rests in a row that a steady acceleration does not last */
#define JUDGED     (PLUMB_ATTITUDE_FLAG_UNSURE | PLUMB_ATTITUDE_FLAG_ACCELERATING)

/* Judges the velocity of a block: how far it may be taken for zero, and whether the attitude is lost, which
 * starts the filter again. */
SELDOM PART void plumb_attitude_judge(plumb_attitude_t *c, const plumb_attitude_params_t *p);

#endif
