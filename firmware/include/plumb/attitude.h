/* Attitude in three dimensions from a three-axis gyro and accelerometer.
 *
 * Every step: the counts become rates and accelerations; the rates turn the quaternion; the acceleration,
 * in earth axes, is added to the sums of a block. Every block: a Kalman filter of ten errors (bias and scale
 * of the gyro, tilt, horizontal velocity) takes the sums and corrects attitude, bias, scale and velocity.
 *
 * The filter measures one thing: that a body does not move away, so that the integral of its horizontal
 * acceleration stays small. A velocity that lasts weakens that measurement. A block is about 0.12 s; its
 * covariance is computed in slices, one a step, while the next block is summed up. docs/systems/attitude.md
 * derives the equations, docs/reference/arithmetic/attitude.md gives every word.
 *
 * A vehicle with rotors may declare an aid, the drag of its rotors: in flight it measures the velocity
 * instead (R. Leishman et al., Quadrotors and accelerometers, IEEE Control Systems 34(1), 2014).
 *
 * raw: gyro x, y, z (group gyro, turn/s Q28, within +-7), acceleration x, y, z (group accel, g Q26); counts
 * of -32768: no sample. The heading of the quaternion is the integrated gyro's. The system drives no pin.
 */
#ifndef PLUMB_ATTITUDE_H
#define PLUMB_ATTITUDE_H

#include "plumb/error_filter.h"
#include "plumb/records.h"
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* State of the estimator: the record of the last step, then what the next one needs besides. */
typedef struct {
    plumb_attitude_words_t words;
    plumb_error_filter_t errors;
    int32_t rows_sum_q22[2][3];   /* of the block so far: horizontal rows of the attitude's matrix */
    int32_t turned_sum_q28[2][3]; /* of the block so far: those times the half angles */
    int32_t force_sum_q18[3];     /* of the block so far: acceleration in earth axes, g */
    int32_t force_before_q18[3];  /* of the block before */
    int32_t half_sum_q32[3];      /* of the block so far: half angles, rad, modulo 1 */
    int32_t half_mean_q32[3];     /* of the block before */
    uint32_t energy_q24;          /* of the block so far: squares of the half angles */
    int32_t half_sixth_q32[3];    /* of the step before: a sixth of the half angle */
    int32_t accel_sixth_q25[3];   /* of the step before */
    int32_t tilt_added_q32;       /* of the block so far: variance by gaps and clipped rates, rad^2 */
    int32_t velocity_added_q26;   /* the same by accelerations, g^2 s^2 */
    uint32_t gyro_slope_q32;      /* of a run of clipped rates: square of the slope, a 36th of rad^2 a step */
    uint32_t accel_slope_q18;     /* of a run of clipped accelerations: a 36th of g^2 a step */
    int32_t thrust_sum_q18[2];    /* of the block so far: acceleration along the body's z, earth axes, g */
    int32_t measured_gs_q28[2];   /* velocity that the last block is measured to have */
    int32_t travel_gs_q28[2]; /* low-pass of the velocity, in flight of its difference from the measured */
    int32_t corrected_rad_q26[2]; /* sum of the tilt's corrections, forgotten with 10 s */
    int32_t travel_excess_q24;    /* square of it beyond what is expected, remembered, g^2 s^2 */
    int32_t rise_g_q18;           /* low-pass of 1 g less the vertical acceleration */
    int32_t turning_rad_q26;      /* low-pass of the half angles of a block about x and y of the earth */
    uint32_t block_flags;         /* of the last block */
    uint8_t slice;                /* of the covariance that the next step computes; 0: none */
    uint16_t still_blocks;
    uint8_t aligned_blocks;
    uint8_t gap_steps;           /* without a sample, up to now */
    uint8_t gyro_clipped_steps;  /* in a row, up to now */
    uint8_t accel_clipped_steps; /* in a row, up to now */
    bool moved, started;
    bool vehicle;           /* the caller's: take-off and landing are followed also without an aid */
    bool airborne;          /* with an aid: fewer than PLUMB_ATTITUDE_MAYBE_LANDED_BLOCKS are carried */
    uint8_t carried_blocks; /* in a row in which the ground seems to carry the vehicle, at most LANDED */
    uint8_t thrust_blocks;  /* in a row with the thrust of a hover, up to now */
    uint8_t held_blocks;    /* in a row in which the gyro alone turned, up to now */
    uint8_t flown_blocks;   /* since the take-off, at most 255 */
    int32_t hover_q15;      /* thrust command of a hover, learned in flight; 0: unknown */
    int32_t weight_g_q18;   /* vertical acceleration on the ground: 1 g and the error of the sensor */
    int32_t climb_gs_q28;   /* vertical velocity, forgotten with 4 s: the integral of the acceleration less
                               weight */
} plumb_attitude_t;

/* Of carried_blocks. From the first number on the vehicle may have landed: the velocity is taken for zero. At
 * the second it has landed: until it takes off again its rotors may be stopped. */
#define PLUMB_ATTITUDE_MAYBE_LANDED_BLOCKS 8U
#define PLUMB_ATTITUDE_LANDED_BLOCKS       67U

/* Clear the record, set attitude and covariance of the start. The first sample aligns the attitude. */
void plumb_attitude_init(plumb_attitude_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_attitude_params_valid(const plumb_params_t *p);

/* One step. raw: gyro x, y, z, then acceleration x, y, z, counts; setpoint: thrust
 * command of the vehicle, Q15; 0 without one. The result is c->words. */
void plumb_attitude_step(plumb_attitude_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                         int32_t setpoint);

#ifdef __cplusplus
}
#endif

#endif
