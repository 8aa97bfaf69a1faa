/* Error -> command, with every limit an actuator has.
 *
 *     (1) demand = kp * error + integral - kd * filtered rate     D is of the measured rate
 *     (2) command = demand, limited to +-1 and to +-slew from the last command
 *     (3) integral += ki dt * error, unless (2) limited and this would push it further
 *
 * +-1 is all that the actuator may get: a smaller share is a smaller span of the output and larger gains; the
 * direction is the sign of that span. The integral keeps 64 bits, the sum its upper 32: |kp|, |kd| <= 2^30
 * keep it below 2^30 (pid_valid).
 */
#ifndef PLUMB_CORE_PID_H
#define PLUMB_CORE_PID_H

#include "fixed.h"
#include <stdbool.h>

typedef struct {
    int32_t kp_q22;      /* command per turn; +-2^30 */
    int32_t ki_dt_q22;   /* command per turn and step; 0..2^31-1 */
    int32_t kd_q27;      /* command per turn/s; +-2^30 */
    int32_t d_alpha_q31; /* 1 - exp(-dt / tau) of the D filter; 0..2^31-1 (no filter) */
    int32_t slew_q22;    /* largest change per step; 1..2^23 (no limit) */
} pid_params_t;

typedef struct {
    int64_t integral_q54; /* command; +-2, a guard only */
    int32_t command_q22;  /* -1..1-2^-22 */
    int32_t rate_filtered_turnps_q27;
    int32_t excess_q22;     /* demand - command: not 0 when limited */
    int32_t error_turn_q32; /* as given, kept by the caller as a record */
} pid_t;

void pid_init(pid_t *c);

/* error: setpoint - tilt, turn Q32, already wrapped; rate: measured, turn/s Q28. Constant number of
 * instructions. */
void pid_step(pid_t *c, const pid_params_t *p, int32_t error_turn_q32, int32_t rate_turnps_q28);

bool pid_valid(const pid_params_t *p);

#endif
