/* Hall edges -> speed of the wheels and acceleration of the axle.
 *
 *     speed    = edges of this step * length of one edge / dt
 *     velocity = speed after a first-order low-pass
 *     accel    = slope of velocity
 *
 * One edge more or less in a step makes the speed jump. The low-pass spreads the jump, and its effect on the
 * acceleration cancels over the next steps.
 */
#ifndef PLUMB_WHEEL_H
#define PLUMB_WHEEL_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Settings. */
typedef struct {
    int32_t edges_max;      /* per step, 1..32767; more are clamped */
    int32_t edge_mps_q26;   /* speed at one edge per step; the sign sets the direction */
    int32_t alpha_q31;      /* 1 - exp(-dt / tau) of the filter; 0..2^31-1 */
    int32_t accel_gain_q30; /* alpha / (dt * 1 g): g per m/s; 0..2^31-1, 0 for no acceleration at all */
} plumb_wheel_params_t;

/* State, and what the last step gave. */
typedef struct {
    int32_t speed_mps_q26;    /* of this step, +-15 m/s */
    int32_t velocity_mps_q26; /* filtered */
    int32_t accel_g_q26;      /* +-3 g */
} plumb_wheel_t;

/* One step; begin with all zero. edges: signed, of this step. True when edges or acceleration were clamped.
 */
bool plumb_wheel_step(plumb_wheel_t *c, const plumb_wheel_params_t *p, int32_t edges);

/* The ranges above, and that no speed can leave +-15 m/s. */
bool plumb_wheel_valid(const plumb_wheel_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
