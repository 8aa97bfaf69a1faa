/* Plausibility: do gyro and accelerometer agree, and is the system ready to be armed?
 *
 * Runs after control_step() on the record of the step and changes nothing in it. Three checks run on every
 * step. Each fails when its condition was met for the time given here, and recovers as slowly as it failed,
 * so that one odd sample neither fails nor clears it:
 *
 *     ACCEL       the length of the acceleration is outside the system's bounds, 200 ms
 *     INNOVATION  the innovation is above 15 deg and above 6 of its standard deviations, 300 ms, once the
 *                 filter has converged. While its gain k0 exceeds 2 a second, the filter would soon hide the
 *                 innovation: each step then counts as four, so that 75 ms suffice
 *     RATE        the tilt that the accelerometer measures turns by 60 deg/s faster or slower than the gyro
 *                 says, 120 ms. The difference is low-passed with 0.25 s: the accelerometer's noise,
 *                 differentiated over one step, would be hundreds of deg/s. Or: the two differ from step to
 *                 step, in any direction, by more than the system's bound, mean over 0.25 s: noise. Or, of a
 *                 system that measures its own estimate while it does not believe its accelerometer:
 *                 gravity points down in the sensor while the estimate is within 60 deg of upright
 *
 * A system is ready when it is at rest, the filter has converged, the setpoint is 0, or small, and the tilt
 * is below the system's limit, all of them for 300 ms.
 *
 * Not detected: a sensor that reads its rest value while nothing moves; an accelerometer that is wrong by
 * less than the limits from the first step on.
 */
#ifndef PLUMB_PLAUSIBILITY_H
#define PLUMB_PLAUSIBILITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Which checks fail. Bits, as in PLAUSIBILITY. */
#define PLUMB_PLAUSIBILITY_ACCEL      0x0001U
#define PLUMB_PLAUSIBILITY_INNOVATION 0x0002U
#define PLUMB_PLAUSIBILITY_RATE       0x0004U

/* What is missing before arming. Bits, as in PLAUSIBILITY. */
#define PLUMB_PLAUSIBILITY_SETTLING    0x0001U /* the other conditions have not held for long enough */
#define PLUMB_PLAUSIBILITY_MOVING      0x0002U /* not at rest: turning, or accelerated */
#define PLUMB_PLAUSIBILITY_CONVERGING  0x0004U /* the filter has not converged */
#define PLUMB_PLAUSIBILITY_SETPOINT    0x0008U /* the setpoint is not 0 */
#define PLUMB_PLAUSIBILITY_TILTED      0x0010U /* too far from level or upright */
#define PLUMB_PLAUSIBILITY_MISSING_ALL 0x001FU

/* What is checked of a system: the places of the signals in its record, in words of 32 bits from its start,
 * and their plausible ranges. */
typedef struct {
    uint8_t setpoint;       /* at rest setpoint_max at most, of either sign */
    uint8_t rate;           /* turn/s Q28, calibrated, bias included */
    uint8_t rate_corrected; /* turn/s Q28 */
    uint8_t accel[2];       /* g Q26, along two axes */
    uint8_t tilt_measured;  /* turn Q32 */
    uint8_t tilt;           /* turn Q32, fused */
    uint8_t variance;       /* R of the step, 2^32 lsb */
    uint8_t innovation;     /* turn Q32 */
    uint8_t k0;             /* Q29 */
    uint8_t stopped; /* why the step has stopped the motors, while it is not 0; place 0: it never does */
    uint32_t setpoint_max;
    uint32_t accel_min_g2_q20; /* range of the squared length of the acceleration */
    uint32_t accel_max_g2_q20;
    uint32_t rest_min_g2_q20; /* range of its mean at rest */
    uint32_t rest_max_g2_q20;
    uint32_t rest_turnps_q28; /* largest mean of |corrected rate| at rest */
    uint32_t uneven_turn_q32; /* largest mean difference of a step's turn, accelerometer less gyro */
    uint32_t ready_turn_q32;  /* largest tilt at which the system may be armed */
    bool doubts; /* where the step does not believe the accelerometer, the tilt it measures is its estimate */
} plumb_plausibility_bounds_t;

/* The places of a system's record, the first members of its bounds. The setpoint and the accelerations along
 * the two axes have names of their own; the others are those that every record of one tilt has. */
#define PLUMB_PLAUSIBILITY_AT(words_t, word) (uint8_t)(offsetof(words_t, word) / 4U)
#define PLUMB_PLAUSIBILITY_PLACES(words_t, setpoint_word, accel_0_word, accel_1_word)                        \
    .setpoint = PLUMB_PLAUSIBILITY_AT(words_t, setpoint_word),                                               \
    .rate = PLUMB_PLAUSIBILITY_AT(words_t, rate_turnps_q28),                                                 \
    .rate_corrected = PLUMB_PLAUSIBILITY_AT(words_t, rate_corrected_turnps_q28),                             \
    .accel = {PLUMB_PLAUSIBILITY_AT(words_t, accel_0_word), PLUMB_PLAUSIBILITY_AT(words_t, accel_1_word)},   \
    .tilt_measured = PLUMB_PLAUSIBILITY_AT(words_t, tilt_measured_turn_q32),                                 \
    .tilt = PLUMB_PLAUSIBILITY_AT(words_t, tilt_turn_q32),                                                   \
    .variance = PLUMB_PLAUSIBILITY_AT(words_t, variance),                                                    \
    .innovation = PLUMB_PLAUSIBILITY_AT(words_t, kalman.innovation_turn_q32),                                \
    .k0 = PLUMB_PLAUSIBILITY_AT(words_t, kalman.k0_q29)

/* State, and what the last step found. */
typedef struct {
    uint32_t accel_s_q33; /* of each check: counts up while its condition is met, down while it is not */
    uint32_t innovation_s_q33;
    uint32_t rate_s_q33;
    uint32_t converged_s_q33;     /* how long the mean innovation has been near 0; stops at its limit */
    uint32_t ready_s_q33;         /* how long all conditions for arming have been met; stops at its limit */
    int32_t mismatch_turn_q32;    /* angle by the accelerometer minus angle by the gyro, leaks in 0.25 s */
    int32_t unevenness_turn_q32;  /* mean over 0.25 s of the size of a step of that angle, up to 45 deg */
    int32_t measured_turn_q32;    /* measured tilt of the previous step */
    int32_t rate_turnps_q28;      /* rate of the previous step */
    int32_t innovation_turn_q32;  /* mean over 0.25 s of the innovation */
    int32_t rate_mean_turnps_q28; /* mean over 0.25 s of |corrected rate| */
    int32_t accel_mean_g2_q20;    /* mean over 0.25 s of the squared acceleration */
    bool begun;                   /* a step was seen */
    bool converged;               /* the filter has converged in this run */
    uint16_t failed;              /* PLUMB_PLAUSIBILITY_ACCEL and so on, now */
    uint16_t missing;             /* PLUMB_PLAUSIBILITY_SETTLING and so on, now */
} plumb_plausibility_t;

/* Call at the start of a run: no check fails, all conditions for arming are missing. */
void plumb_plausibility_init(plumb_plausibility_t *p);

/* Call after each step. record: its words; dt_s_q33: the period, up to 0.1 s; variance_turn2_q56: the value
 * of 2^32 lsb of variance in turn^2, 0 when it is unknown (then only the limit of 15 deg holds for the
 * innovation). */
void plumb_plausibility_step(plumb_plausibility_t *p, const plumb_plausibility_bounds_t *bounds,
                             const void *record, int32_t dt_s_q33, uint32_t variance_turn2_q56);

#ifdef __cplusplus
}
#endif

#endif
