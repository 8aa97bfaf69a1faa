/* Attitude quaternion from a gyro and an angular-acceleration sensor with different sample rates.
 *
 *     counts -> missing samples, spikes, noise -> alignment -> lag -> data or attitude layer -> quaternion
 *
 * Steps run at the sample rate of the angular accelerometer (raw[3..5]). Gyro samples (raw[0..2]) arrive in
 * some steps; an accumulator of gyro_period holds their age relative to the step. A count of -32768 means
 * that there is no sample. The first rest_steps are at rest: both biases are estimated, the attitude is
 * constant.
 *
 * Data layer: the difference of the rates corrects rate, biases, angle, scale and lag. Attitude layer: each
 * sensor has its own attitude, and their difference corrects both. If a sensor is lost, the other one alone
 * propagates the attitude.
 */
#ifndef PLUMB_TURNTABLE_H
#define PLUMB_TURNTABLE_H

#include "plumb/design.h"
#include "plumb/quaternion.h"
#include "plumb/records.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of the estimator: the record of the last step. */
typedef struct {
    plumb_turntable_words_t words;
} plumb_turntable_t;

/* Clear the record and set the initial attitudes, age, lag, gaps and variances. */
void plumb_turntable_init(plumb_turntable_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_turntable_params_valid(const plumb_params_t *p);

/* One step. raw: gyro x, y, z (turn/s Q28 by `gyro`), angular acceleration x, y, z (turn/s^2 Q28 by
 * fusion.angular); setpoint: unused. The result is c->words. */
void plumb_turntable_step(plumb_turntable_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                          int32_t setpoint);

/* Prefilter of one sensor. */
typedef struct {
    double
        spike; /* deg/s or deg/s^2: further from the line through the last two samples is a spike; above 0 */
    double smooth; /* share of a new sample in a one-pole low-pass: above 0, up to 1 for none */
} plumb_prefilter_tuning_t;

/* Quantities that the turntable's fusion compares. */
typedef enum {
    PLUMB_TUNING_LAYER_DATA = 0,     /* rates, with the angle a state */
    PLUMB_TUNING_LAYER_ATTITUDE = 1, /* two attitudes */
    PLUMB_TUNING_LAYER_PRINTED = 2   /* rates; the corrected rate alone turns the quaternion */
} plumb_layer_choice_t;

/* Fusion of gyro and angular accelerometer: noise as densities, initial standard deviations. All at least 0.
 */
typedef struct {
    double gyro_period_s; /* 1 to 16 steps; taken as the nearest fraction with a denominator up to 10^7 */
    double gyro_phase_s;  /* a sampling instant of the gyro, counted from the first step; up to 10^9 */
    double gyro_scale;    /* scale error of the gyro; 0 with angular_scale: not estimated */
    double angular_scale;
    int32_t layer;             /* plumb_layer_choice_t */
    double rest_s;             /* the run begins at rest */
    double lag_s;              /* of the gyro, up to 16 steps */
    double gyro_dps;           /* noise, deg/s per root Hz */
    double angular_dps2;       /* noise, deg/s^2 per root Hz */
    double lost_dps2;          /* what stands for it while the angular accelerometer is lost */
    double gyro_walk_dps;      /* deg/s per root s */
    double angular_walk_dps2;  /* deg/s^2 per root s */
    double start_gyro_dps;     /* of the gyro's bias */
    double start_angular_dps2; /* of the other one's */
    double start_lag_s;        /* of the lag, up to one step; 0: not estimated */
} plumb_fusion_tuning_t;

/* Settings of the turntable. */
typedef struct {
    int32_t period_us;           /* of a step, which is a sample of the angular accelerometer: 500 to 10000 */
    plumb_channel_tuning_t gyro; /* deg/s */
    plumb_channel_tuning_t angular; /* deg/s^2 */
    plumb_prefilter_tuning_t gyro_filter;
    plumb_prefilter_tuning_t angular_filter;
    plumb_fusion_tuning_t fusion;
} plumb_turntable_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_turntable_design(const plumb_turntable_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
