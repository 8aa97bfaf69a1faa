/* Rate of one axis -> command: proportional, integral with anti-windup, derivative of the measured rate
 * behind a first-order low-pass, feed-forward of the rate that is asked for.
 *
 *     (1) demand = kp (asked - rate) + ff asked + integral - kd (rate - low-pass of the step before)
 *     (2) integral += ki dt (asked - rate), unless the command was limited and this would push it further
 *
 * Rates are turn/s Q28 and do not wrap: +-7.75 turn/s (2790 deg/s). A command of 1 is all that the rotors
 * have. The limits are the mixer's, which knows the other axes: after it the caller writes what it could not
 * give into `excess`. On the ground the integral is forgotten, because there a wrong attitude does not come
 * from the rotors.
 */
#ifndef PLUMB_RATE_LOOP_H
#define PLUMB_RATE_LOOP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Settings of one axis. */
typedef struct {
    int32_t kp_q29;    /* command per turn/s; 0..2^30 */
    int32_t ki_dt_q35; /* command per turn/s and step; 0..2^31-1 */
    int32_t kd_q28;    /* command per turn/s; 0..2^30: kd alpha / dt */
    int32_t ff_q29;    /* command per turn/s; 0..2^30 */
} plumb_rate_loop_params_t;

/* State, and what the last step gave. */
typedef struct {
    int32_t rate_filtered_turnps_q27;
    int32_t integral_q30; /* command */
    int32_t demand_q24;   /* command, not limited: +-109 */
    int32_t excess_q24;   /* demand - command, written by the mixer: not 0 when limited */
} plumb_rate_loop_t;

/* The ranges above. */
bool plumb_rate_loop_valid(const plumb_rate_loop_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
