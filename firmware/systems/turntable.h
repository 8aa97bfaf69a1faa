/* Attitude from a gyro and an angular-acceleration sensor of different rates: raw counts in, quaternion out.
 *
 *     counts -> presence, spikes, noise -> alignment -> lag -> data layer or attitude layer -> quaternion
 *
 * Steps run at the rate of the angular accelerometer (raw[3..5]); gyro samples (raw[0..2]) come in some of
 * them, older than the step by an age that an accumulator of gyro_period keeps. A count of -32768 is no
 * sample. The first rest_steps are at rest: they give both biases, and the attitude stays where it is.
 *
 * Data layer: the rate's difference corrects rate, biases, angle, scale and lag. Attitude layer: each sensor
 * has an attitude of its own, their difference corrects both. The loss of either sensor changes what is
 * predicted from what; nothing stops.
 */
#ifndef PLUMB_CORE_TURNTABLE_H
#define PLUMB_CORE_TURNTABLE_H

#include "control_params.h"
#include "core/quaternion.h"

#define TURNTABLE_FLAG_GYRO_SATURATED    (1U << 0)
#define TURNTABLE_FLAG_ANGULAR_SATURATED (1U << 1)
#define TURNTABLE_FLAG_GYRO              (1U << 2) /* this step has a sample of it */
#define TURNTABLE_FLAG_ANGULAR           (1U << 3)
#define TURNTABLE_FLAG_GYRO_SPIKE        (1U << 4) /* on some axis */
#define TURNTABLE_FLAG_ANGULAR_SPIKE     (1U << 5)
#define TURNTABLE_FLAG_SHOCK             (1U << 6) /* an innovation that noise does not explain */
#define TURNTABLE_FLAG_REST              (1U << 7)
#define TURNTABLE_FLAG_GYRO_LOST         (1U << 8)
#define TURNTABLE_FLAGS_SATURATED        (TURNTABLE_FLAG_GYRO_SATURATED | TURNTABLE_FLAG_ANGULAR_SATURATED)

typedef struct {
    int32_t raw[CONTROL_RAW_MAX]; /* counts, as given */
    int32_t setpoint;             /* unused */
    prefilter_t gyro, angular;
    int32_t rate_turnps_q28[3];             /* prefiltered gyro, of its last sample */
    int32_t acceleration_turnps2_q28[3];    /* prefiltered angular acceleration, of its last sample */
    uint32_t gyro_age_step_q24;             /* since the last sampling instant of the gyro */
    int32_t increment_turnps_q34[3];        /* of the rate in this step */
    int32_t increment_lagged_turnps_q34[3]; /* as the gyro's lag passes it */
    int32_t innovation_turnps_q28[3];       /* data layer: gyro; attitude layer: difference per step */
    quaternion_t attitude;                  /* the published one */
    quaternion_t attitude_angular;          /* attitude layer: the angular accelerometer's own */
    int32_t rate_fused_turnps_q28[3];       /* state 0 */
    int32_t rate_corrected_turnps_q28[3];   /* the published one: what turns `attitude` */
    int32_t bias_gyro_turnps_q34[3];
    int32_t bias_angular_turnps_q42[3]; /* per step */
    int32_t scale_q30[3];               /* gyro's scale less the angular accelerometer's */
    int32_t lag_step_q24[3];
    uint32_t clamped_steps; /* so far, steps with a saturated sample */
    int64_t covariance_q64[FUSION_CELLS];
    fusion_parameter_t scale[3], lag[3];
    uint32_t flags; /* TURNTABLE_FLAG_* of this step */
    uint32_t step;  /* number of this step in the run, from 1 */
} turntable_words_t;

/* Its state is its record. */
typedef struct {
    turntable_words_t words;
} turntable_t;

/* The words become zero but for attitudes, age, lag, gaps, and the variances of the start. */
void turntable_init(turntable_t *c, const control_params_t *p);

/* False if a word that the step reads is outside its range, or any sum of the step could overflow. */
bool turntable_params_valid(const control_params_t *p);

/* One step. raw: gyro x, y, z (turn/s Q28 by `gyro`), angular acceleration x, y, z (turn/s^2 Q28 by
 * fusion.angular); setpoint: unused. The result is c->words. */
void turntable_step(turntable_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                    int32_t setpoint);

#endif
