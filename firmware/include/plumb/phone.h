/* Pitch and roll of a phone: two two-state filters, driven by Euler rates or, as in the source, by body
 * rates.
 *
 *     counts -> calibration -> rates of pitch and roll, pitch and roll of the acceleration -> two filters
 *
 * raw: gyro x, y, z, acceleration x, y, z, in the axes of Android. At rest the acceleration is
 * g (-sin(pitch), cos(pitch) sin(roll), cos(pitch) cos(roll)). All three rates share the calibration `gyro`,
 * all three accelerations `accel`: the sender has calibrated the axes. Pitch uses the groups tilt, kalman and
 * start, roll its own. R is constant (tilt.r_base, roll.r_base); r_max replaces it while a measurement is
 * skipped. The system has no controller and drives no pin.
 */
#ifndef PLUMB_PHONE_H
#define PLUMB_PHONE_H

#include "plumb/design.h"
#include "plumb/records.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_PHONE_BODY_RATES  0U /* phone.rates: pitch' = wy, roll' = wx: the source */
#define PLUMB_PHONE_EULER_RATES 1U

/* State of the estimator: the record of the last step. */
typedef struct {
    plumb_phone_words_t words;
} plumb_phone_t;

/* Clear the record and set the initial state of the filters. */
void plumb_phone_init(plumb_phone_t *c, const plumb_params_t *p);

/* True if the parameters are in range and no sum of a step can overflow. */
bool plumb_phone_params_valid(const plumb_params_t *p);

/* One step. raw: gyro x, y, z, then acceleration x, y, z, counts; setpoint: unused. The result is c->words.
 */
void plumb_phone_step(plumb_phone_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                      int32_t setpoint_turn_q32);

/* Rates that drive the filters of phone. */
typedef enum {
    PLUMB_TUNING_RATES_BODY = 0, /* the body's rates, as the source prints it */
    PLUMB_TUNING_RATES_EULER = 1 /* the rates of the angles */
} plumb_rates_choice_t;

/* The filter of one angle. */
typedef struct {
    double q_angle_deg2_per_s; /* at least 0 */
    double q_bias_dps2_per_s;  /* at least 0 */
    double r_deg2;             /* above 0 */
    plumb_start_tuning_t start;
} plumb_phone_axis_tuning_t;

/* Settings of the phone. gyro and accel: the channel of all three axes of each sensor. */
typedef struct {
    int32_t period_us;            /* of a step: 500 to 100000 */
    plumb_channel_tuning_t gyro;  /* deg/s */
    plumb_channel_tuning_t accel; /* g */
    plumb_phone_axis_tuning_t pitch;
    plumb_phone_axis_tuning_t roll;
    int32_t rates;          /* plumb_rates_choice_t */
    double r_left_out_deg2; /* stands in for R where an acceleration tells no angle; at least both r_deg2 */
    int32_t rate;           /* plumb_rate_choice_t */
    double bias_max_dps;    /* 0 to below 360 */
} plumb_phone_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_phone_design(const plumb_phone_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
