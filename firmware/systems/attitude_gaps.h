/* How `attitude` handles samples that are missing or at the limit of a sensor. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_GAPS_H
#define PLUMB_SYSTEMS_ATTITUDE_GAPS_H

#include "attitude_limits.h"

/* Component of an acceleration along a row, Q23 of Q25. */
KERNEL int32_t along(const int32_t m[3], int32_t x, int32_t y, int32_t z) {
    return mulhi_i32(m[0], x) + mulhi_i32(m[1], y) + mulhi_i32(m[2], z);
}

/* Bridges a gap at its next sample. Turn and acceleration in the gap are those of a straight line between the
 * samples on both sides. Their variance is that of a random walk between these samples, (time * difference)^2
 * / 12 with the difference of all three axes, times 1.5, because a single difference says little about the
 * motion. force_g_q20: acceleration that the gap adds, body axes. */
SELDOM PART void plumb_attitude_bridge(plumb_attitude_t *c, const plumb_attitude_params_t *a,
                                       const int32_t half[3], int32_t force_g_q20[3]);

/* Adds the acceleration of a gap to the sums of the block. */
SELDOM PART void plumb_attitude_add_force(plumb_attitude_t *c, const int32_t m[9],
                                          const int32_t force_g_q20[3]);

/* Count samples at the limits, and at their end add the variance of the hidden part. The rates are alone when
 * the accelerations are marked so, or have been at a limit for two blocks. */
SELDOM PART void plumb_attitude_count_clipped(plumb_attitude_t *c, const plumb_attitude_params_t *a,
                                              uint32_t flags, const int32_t half[3]);

#endif
