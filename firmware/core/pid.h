/* Error -> command, with every limit an actuator has.
 *
 *     demand  = kp * error + integral - kd * filtered rate       D acts on the measured rate, not on the
 * error command = demand within the output limits, and within +-slew of the last command integral += ki dt *
 * error, unless the command was limited and this would push it further (anti-windup)
 *
 * The sum is 64 bits wide in Q54: nothing in it can overflow while |kp|, |kd| <= 2^30 (pid_valid).
 */
#ifndef PLUMB_CORE_PID_H
#define PLUMB_CORE_PID_H

#include "fixed.h"
#include <stdbool.h>

typedef struct {
    int32_t kp_q22;           /* command per turn; +-2^30 */
    int32_t ki_dt_q22;        /* command per turn and step */
    int32_t kd_q27;           /* command per turn/s; +-2^30 */
    int32_t d_alpha_q31;      /* 1 - exp(-dt / tau) of the D filter; 0..2^31-1 (no filter) */
    int32_t integral_min_q22; /* command; -2^22..0 */
    int32_t integral_max_q22; /* 0..2^22 */
    int32_t out_min_q30;      /* command; -2^30..2^30-1 */
    int32_t out_max_q30;      /* out_min..2^30-1 */
    int32_t slew_q30;         /* largest change per step; 1..2^31-1 (2^31-1: no limit) */
} pid_params_t;

typedef struct {
    int64_t integral_q54;
    int32_t rate_filtered_turnps_q27;
    int32_t demand_q30;  /* before the limits, saturated to +-2 */
    int32_t command_q30; /* in [out_min, out_max] once reached; starts at 0 */
    uint32_t limited;    /* 1 if the command is not the demand */
} pid_t;

void pid_init(pid_t *c);

/* error: setpoint - tilt, turn Q32, already wrapped; rate: measured, turn/s Q28. Constant number of
 * instructions. */
void pid_step(pid_t *c, const pid_params_t *p, int32_t error_turn_q32, int32_t rate_turnps_q28);

bool pid_valid(const pid_params_t *p);

#endif
