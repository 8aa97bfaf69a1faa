/* One axis of a quadrotor: from raw counts to the pulses of two opposing motors, with all intermediate
 * values.
 *
 *     counts -> calibration -> tilt and its variance -> kalman -> pid -> pulses
 */
#ifndef PLUMB_QUAD_H
#define PLUMB_QUAD_H

#include "plumb/design.h"
#include "plumb/plausibility.h"
#include "plumb/records.h"

#ifdef __cplusplus
extern "C" {
#endif

/* State of the controller: the record of the last step. */
typedef struct {
    plumb_quad_words_t words;
} plumb_quad_t;

/* Clear the record and set the initial state of filter and controller. */
void plumb_quad_init(plumb_quad_t *c, const plumb_params_t *p);

/* False if any sum of the step could overflow: 64-bit products, no division. */
bool plumb_quad_params_valid(const plumb_params_t *p);

/* One step. raw: gyro (turn/s Q28 by its calibration), acceleration along y and z (g Q26), three unused;
 * setpoint: turn Q32. The result is c->words. */
void plumb_quad_step(plumb_quad_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                     int32_t setpoint_turn_q32);

/* Other gains from the next step on, without a jump of the command (plumb_pid_retune). */
void plumb_quad_retune(plumb_quad_t *c, const plumb_params_t *from, const plumb_params_t *to);

/* Bounds for plausible sensors, and conditions for arming. */
extern const plumb_plausibility_bounds_t plumb_quad_plausibility;

/* Settings of the quad. */
typedef struct {
    int32_t period_us; /* of a step: 500 to 100000 */
    plumb_calibration_tuning_t calibration;
    plumb_kalman_tuning_t kalman;
    plumb_trust_tuning_t trust;
    int32_t tilt; /* plumb_tilt_choice_t */
    plumb_start_tuning_t start;
    plumb_pid_tuning_t pid;
    plumb_esc_tuning_t esc;
} plumb_quad_tuning_t;

/* Convert a tuning to parameters; a refused setting leaves *params unchanged (plumb/design.h). */
plumb_design_t plumb_quad_design(const plumb_quad_tuning_t *tuning, plumb_params_t *params);

#ifdef __cplusplus
}
#endif

#endif
