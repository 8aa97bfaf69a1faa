/* The body of plumb/rate_loop.h, inlined into the steps: the manual is there, with the equations (1) and (2).
 */
#ifndef PLUMB_CORE_RATE_LOOP_H
#define PLUMB_CORE_RATE_LOOP_H

#include "fixed.h"
#include "plumb/rate_loop.h"

/* State of the vehicle, which decides what happens to the integral. */
typedef enum {
    RATE_LOOP_OFF,      /* the rotors are off: the integral is 0 */
    RATE_LOOP_GROUNDED, /* the integral decays by a 32nd per step */
    RATE_LOOP_HELD,     /* it may stand on the ground: the integral stays */
    RATE_LOOP_FLYING
} rate_loop_mode_t;

KERNEL void rate_loop_step(plumb_rate_loop_t *restrict c, const plumb_rate_loop_params_t *restrict p,
                           int32_t d_alpha_q31, int32_t integral_max_q30, int32_t asked_turnps_q28,
                           int32_t rate_turnps_q28, rate_loop_mode_t mode) {
    const int32_t asked = asr32(asked_turnps_q28, 1), rate = asr32(rate_turnps_q28, 1);
    const int32_t error = asked - rate;
    const int32_t change = sub_wrap(rate, c->rate_filtered_turnps_q27);
    c->rate_filtered_turnps_q27 = add_wrap(c->rate_filtered_turnps_q27, 2 * mulhi_i32(change, d_alpha_q31));

    if (mode == RATE_LOOP_OFF) {
        c->integral_q30 = 0;
    } else if (mode == RATE_LOOP_GROUNDED) {
        c->integral_q30 -= asr32(c->integral_q30, 5);
    } else if (mode == RATE_LOOP_FLYING &&
               (c->excess_q24 == 0 || error == 0 || (c->excess_q24 ^ error) < 0)) {
        c->integral_q30 =
            clamp_i32(c->integral_q30 + mulhi_i32(error, p->ki_dt_q35), -integral_max_q30, integral_max_q30);
    }
    c->demand_q24 = mulhi_i32(error, p->kp_q29) + mulhi_i32(asked, p->ff_q29) -
                    2 * mulhi_i32(change, p->kd_q28) + asr32(c->integral_q30, 6);
}

#endif
