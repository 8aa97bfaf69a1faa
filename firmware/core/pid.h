/* Tilt error to command: P on the error, I with clamp and conditional integration, D on the measured rate
 * behind a first-order filter, then output limits and slew limit. DESIGN.md, "Numbers", has every format and
 * rounding.
 *
 * Cost: a constant number of instructions; `plumb bench` counts them. */
#ifndef PLUMB_CORE_PID_H
#define PLUMB_CORE_PID_H

#include <stdint.h>

/* Gains are per turn and turn/s of the measurement; the command is 1.0 at 2^28. */
typedef struct {
    int32_t kp_q16;           /* command per turn, 0 .. 2^31-1 */
    int32_t ki_q28;           /* command per turn and step, 0 .. 2^31-1 */
    int32_t kd_q16;           /* command per turn/s, 0 .. 2^31-1 */
    int32_t filter_q30;       /* share of the new rate in the filtered one, 1 .. 2^30 (no filter) */
    int32_t integral_min_q28; /* -2^28 .. integral_max */
    int32_t integral_max_q28; /* .. 2^28 */
    int32_t command_min_q28;  /* -2^28 .. command_max */
    int32_t command_max_q28;  /* .. 2^28 */
    int32_t slew_q28;         /* largest change per step, 1 .. 2^29 */
} pid_params_t;

/* State. All of it is among the words of a step. */
typedef struct {
    int64_t integral_q60;
    int32_t rate_filtered_turnps_q28;
    int32_t command_q28; /* the last output */
} pid_state_t;

/* One step; returns the command, which is also kept. error wraps: setpoint minus tilt. */
int32_t pid_step(pid_state_t *pid, const pid_params_t *p, int32_t error_turn_q32, int32_t rate_turnps_q28);

#endif
