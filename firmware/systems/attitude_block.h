/* The end of a block of `attitude`, and its computations in the steps of the next block, one slice a step:
 * correction, judgement, growth and measurements. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_BLOCK_H
#define PLUMB_SYSTEMS_ATTITUDE_BLOCK_H

#include "attitude_limits.h"

/* Computes one slice of the last block. Returns true when it has turned the attitude. */
SHARED PART bool plumb_attitude_compute_slice(plumb_attitude_t *c, const plumb_attitude_params_t *p);

/* The last step of a block: its sums become the coupling of tilt and gyro, a velocity, and the inputs of the
 * slices of the next block. Returns true when it has turned the attitude. */
SELDOM PART bool plumb_attitude_close_block(plumb_attitude_t *c, const plumb_attitude_params_t *p);

#endif
