/* Checks of the counts of a digital sensor, axis by axis: one that stands still for longer than its noise
 * allows, and one at its rail. Times are sums over samples, in us. Included by imu_counts.c alone. */
#ifndef PLUMB_STM32F103_IMU_WATCH_H
#define PLUMB_STM32F103_IMU_WATCH_H

#include "imu_chip.h"

/* Longest limit of an axis while the motors may turn: then a rate changes by 0.4 deg/s rms at least, an
 * acceleration by 5 mg rms, more than the noise at rest behind a narrow filter. */
#define IMU_STILL_DRIVEN_US 400000U

#define IMU_STILL_STOPS_US 1000000000U /* above every limit */

/* At the rail for 20 ms, and for three samples: not to be trusted. A sensor that jumps to its rail and back
 * is found, too: the first sample of each visit counts as five, and each sample elsewhere takes 1/256 off.
 * At 400 Hz three such jumps are enough, 80 samples apart; one alone is forgotten after 3 s. */
#define IMU_RAIL_US      20000U
#define IMU_RAIL_LEAST   3U
#define IMU_RAIL_FIRST   4U /* samples that a visit begins with, beside its own */
#define IMU_FORGET_SHIFT 8U

typedef struct {
    uint32_t whole_us;          /* for so long all axes have repeated */
    uint32_t axis_us[IMU_AXES]; /* for so long the axis has repeated while it should have moved */
    uint32_t railed_us;         /* leaky */
    bool at_rail;               /* in the last sample */
    bool railed;                /* not to be trusted */
} imu_watch_t;

/* Feed the axes whose counts are those of the sample before, and those that should have moved, bit 0 is x.
 * sample_us: since the sample before, at most a reading. Returns for how long an axis has repeated while it
 * should have moved. */
static inline uint32_t imu_watch_still(imu_watch_t *watch, uint32_t repeated, uint32_t moved,
                                       uint32_t sample_us) {
    uint32_t longest_us = 0U;
    for (uint32_t axis = 0U; axis < IMU_AXES; axis++) {
        uint32_t us = watch->axis_us[axis] + ((moved >> axis & 1U) != 0U ? sample_us : 0U);
        us = (repeated >> axis & 1U) == 0U ? 0U : us < IMU_STILL_STOPS_US ? us : IMU_STILL_STOPS_US;
        watch->axis_us[axis] = us;
        longest_us = us > longest_us ? us : longest_us;
    }
    const uint32_t whole_us = watch->whole_us + sample_us;
    watch->whole_us = repeated != (1U << IMU_AXES) - 1U ? 0U
                      : whole_us < IMU_STILL_STOPS_US   ? whole_us
                                                        : IMU_STILL_STOPS_US;
    return longest_us;
}

/* Feed whether an axis of the sample is at its rail. sample_us: since the sample before. */
static inline void imu_watch_rail(imu_watch_t *watch, bool at_rail, uint32_t sample_us) {
    const uint32_t most_us = (IMU_RAIL_US + IMU_RAIL_LEAST - 1U) / IMU_RAIL_LEAST;
    const uint32_t by_us = sample_us < most_us ? sample_us : most_us;
    const uint32_t forgotten_us = (by_us >> IMU_FORGET_SHIFT) + 1U;
    const uint32_t limit_us = IMU_RAIL_US + IMU_RAIL_FIRST * by_us;
    if (!at_rail) {
        watch->railed_us -= forgotten_us < watch->railed_us ? forgotten_us : watch->railed_us;
    } else if (watch->railed_us < limit_us) {
        watch->railed_us += watch->at_rail ? by_us : (1U + IMU_RAIL_FIRST) * by_us;
    }
    watch->at_rail = at_rail;
    watch->railed = watch->railed_us >= (watch->railed ? limit_us - by_us : limit_us);
}

#endif
