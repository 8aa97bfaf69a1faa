/* The rate of `turntable`: how a measurement corrects it, and the comparison of both sensors in the data
 * layer. */
#ifndef PLUMB_SYSTEMS_TURNTABLE_RATE_H
#define PLUMB_SYSTEMS_TURNTABLE_RATE_H

#include "core/fusion.h"
#include "plumb/turntable.h"
#include "systems/parts.h"

#define RATE_MAX       1879048192         /* 7 turn/s Q28 */
#define INNOVATION_MAX (1 << 30)          /* 4 turn/s Q28 */
#define STILL_Q64      ((int64_t)1 << 32) /* of zero rate at rest, and of zero difference: (0.006 deg/s)^2 */

/* Intermediate values of one step. */
typedef struct {
    bool gyro, angular, gyro_lost, rest, shock;
    bool two_attitudes;          /* attitude layer: the attitudes turn each by its own sensor */
    int32_t age_q24;             /* of the gyro's sample */
    int32_t lagged_q34[3];       /* lagged increment at the sample's instant */
    int32_t expected_q28[3];     /* rate there, less what the lag takes off */
    int64_t turn_q60[3];         /* rotation of `attitude` in this step */
    int64_t turn_angular_q60[3]; /* of the angular accelerometer's attitude, or of both */
} turntable_step_t;

/* *x += gain * innovation, clamped to +-limit. */
KERNEL void correct_one(int32_t *x, int32_t gain_q28, int32_t innovation_q28, unsigned shift, int32_t limit) {
    *x = clamp_i32(add_scaled(*x, gain_q28, innovation_q28, shift), -limit, limit);
}

/* Correct rate and biases of one axis by a measurement. */
PART void plumb_turntable_correct(plumb_turntable_words_t *w, unsigned i, const int32_t gain_q28[FUSION_ROWS],
                                  int32_t innovation_q28);

/* A rotation of gain times innovation, turn Q60, within a quarter turn. */
static inline int64_t correction_q60(int32_t gain_q28, int32_t innovation_q28) {
    return 16 * within_i64(mul_i64(gain_q28, innovation_q28), (int64_t)1 << 54);
}

/* Data layer: compare the gyro's sample with the predicted rate. */
PART void plumb_turntable_compare_rates(plumb_turntable_words_t *w, const plumb_fusion_params_t *f,
                                        turntable_step_t *s);

#endif
