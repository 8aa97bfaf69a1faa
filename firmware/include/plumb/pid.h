/* Error -> command in -1 to 1: proportional, integral with anti-windup, derivative of the measured rate
 * behind a first-order filter, limit of the command and of its change.
 *
 *     (1) demand = kp * error + integral - kd * filtered rate     D acts on the measured rate
 *     (2) command = demand, limited to +-1 and to +-slew from the last command
 *     (3) integral += ki dt * error, unless (2) limited and this would push it further
 *
 *     (4) between two steps, other gains: integral += (kp error - kd filtered rate) of the old gains
 *                                                     - (kp error - kd filtered rate) of the new ones
 *
 * +-1 is the full range of the actuator. To use less of it, reduce the span of the output and raise the
 * gains; the sign of the span sets the direction. The integral has 64 bits; (1) uses its upper 32. |kp|, |kd|
 * <= 2^30 keep the sum below 2^30 (plumb_pid_valid). (4) leaves the demand of the last error and rate as it
 * was to the last bit, because the products of (1) and (4) are rounded alike; it is done only where ki dt is
 * not 0.
 */
#ifndef PLUMB_PID_H
#define PLUMB_PID_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_PID_ONE_Q22 (1 << 22) /* full command */

/* Settings. */
typedef struct {
    int32_t kp_q22;      /* command per turn; +-2^30 */
    int32_t ki_dt_q22;   /* command per turn and step; 0..2^31-1 */
    int32_t kd_q27;      /* command per turn/s; +-2^30 */
    int32_t d_alpha_q31; /* 1 - exp(-dt / tau) of the D filter; 0..2^31-1 (no filter) */
    int32_t slew_q22;    /* largest change per step; 1..2^23 (no limit) */
} plumb_pid_params_t;

/* State, and what the last step gave. */
typedef struct {
    int64_t integral_q54; /* command; +-2, a guard only */
    int32_t command_q22;  /* -1..1-2^-22 */
    int32_t rate_filtered_turnps_q27;
    int32_t excess_q22;     /* demand - command: not 0 when limited */
    int32_t error_turn_q32; /* plumb_pid_step() does not touch it: the caller records its error here, and a
                               retuning reads it */
} plumb_pid_t;

/* All zero. */
void plumb_pid_init(plumb_pid_t *c);

/* One step. error: setpoint - tilt, turn Q32, already wrapped; rate: measured, turn/s Q28. The result is
 * c->command_q22; c->excess_q22 is not 0 when a limit acted. A constant number of instructions. */
void plumb_pid_step(plumb_pid_t *c, const plumb_pid_params_t *p, int32_t error_turn_q32,
                    int32_t rate_turnps_q28);

/* Other gains from the next step on, without a jump: what they would change of the demand at the last error
 * and rate moves into the integral, which is limited as in a step. With ki_dt 0 nothing moves: no step would
 * take it away again. Call between two steps; the slew limit holds as ever. */
void plumb_pid_retune(plumb_pid_t *c, const plumb_pid_params_t *from, const plumb_pid_params_t *to);

/* The ranges above. */
bool plumb_pid_valid(const plumb_pid_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
