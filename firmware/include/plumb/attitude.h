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

#include "plumb/design.h"
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

/* Matrix from the axes of a sensor to the body's, row by row: its axis map, times what corrects scale and
 * misalignment. The absolute values of a row sum to less than 2, the determinant is 1/2 to 2. It is refused
 * as a whole, as "gyro_mounting" or "accel_mounting": asked is then an entry of 2 or more, or the
 * determinant.
 */
typedef struct {
    double xx, xy, xz; /* body x from the sensor's x, y, z */
    double yx, yy, yz;
    double zx, zy, zz;
} plumb_mounting_tuning_t;

/* Errors of the gyro that the filter expects: standard deviations before the first sample, and noise. */
typedef struct {
    double bias_dps;      /* before the first sample: above 0 */
    double scale;         /* scale error before the first sample, share: above 0 */
    double bias_walk_dps; /* random walk of the bias, deg/s per sqrt(s): at least 0 */
    double noise_dps;     /* noise density, deg/s per sqrt(Hz): at least 0 */
    double turn_noise;    /* noise density for every deg/s of rate: misalignment, lag, bending; at least 0 */
    double scale_walk;    /* random walk of the scale error, per sqrt(s): at least 0 */
    double clipped_deg;   /* of the tilt, what a block without any sample adds: at least 0 */
    double turn_doubt;    /* added to turn_noise by every m/s of a lasting velocity beyond velocity_mps */
} plumb_attitude_gyro_tuning_t;

/* How the body moves: it accelerates, but does not move away. Standard deviations. */
typedef struct {
    double velocity_mps;   /* velocity of a body that moves little: above 0 */
    double share;          /* of the mean square of the integrated velocity, added to its square: 0 to 16 */
    double pass_s;         /* time constant of that mean square: at least 3 blocks */
    double leak_s;         /* with which the integrated velocity forgets: at least 4 blocks */
    double start_tilt_deg; /* before the first sample: above 0 */
    double start_velocity_mps; /* before the first sample: above 0 */
    double unsure_deg;         /* of the tilt, from which it is flagged: at least 0 */
    double travel_mps;         /* lasting velocity beyond which the tilt waits: at least 0 */
    double travel_s;           /* for which a velocity lasts: at least 4 blocks */
} plumb_attitude_motion_tuning_t;

/* What counts as rest, which measures the bias. */
typedef struct {
    double gyro_dps;  /* largest distance of a rate from the mean of the block before: at least 0 */
    double accel_g;   /* the same of a block's mean acceleration: at least 0 */
    double turn_dps;  /* largest mean rate of a block; beyond it is a turn, no bias: at least 0 */
    double seconds;   /* without motion: above 0, up to 255 blocks */
    double noise_dps; /* standard deviation of a block's mean rate: above 0 */
} plumb_attitude_rest_tuning_t;

/* What tells the velocity of a vehicle in flight: the drag of its rotors. */
typedef struct {
    double drag_per_s;   /* drag by mass and speed: 1/64 to 16; 0: no vehicle, or no such aid */
    double velocity_mps; /* standard deviation of the velocity that the drag tells: above 0 */
    double hover;        /* thrust command of a hover, share of the most: 0 to 0.85; 0: unknown */
} plumb_attitude_aid_tuning_t;

/* Settings of the attitude. gyro and accel: the channel of all three axes of each sensor. */
typedef struct {
    int32_t period_us;            /* of a step: 1000 to 21000 */
    plumb_channel_tuning_t gyro;  /* deg/s */
    plumb_channel_tuning_t accel; /* g */
    plumb_mounting_tuning_t gyro_mounting;
    plumb_mounting_tuning_t accel_mounting;
    plumb_attitude_gyro_tuning_t errors;
    plumb_attitude_motion_tuning_t motion;
    plumb_attitude_rest_tuning_t rest;
    plumb_attitude_aid_tuning_t aid;
    double block_s; /* between two measurements of the filter: 15 to 125 steps, below 0.318 s */
} plumb_attitude_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_attitude_design(const plumb_attitude_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
