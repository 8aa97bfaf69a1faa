/* One step of whichever system the parameters select: raw counts in, outputs and every intermediate kept.
 *
 * The caller owns all memory. A step depends on nothing but its arguments and *c. The words of a step are its
 * record: the digest is the CRC-32 of their bytes, little-endian, as the system's X_words_t has them; that
 * order is the written order. Every record begins with the raw counts and the setpoint as given (7 words) and
 * ends with the flags and the number of the step (2 words). No output depends on arming or on time.
 */
#ifndef PLUMB_CORE_CONTROL_H
#define PLUMB_CORE_CONTROL_H

#include "balancer.h"
#include "control_params.h"
#include "phone.h"
#include "quad.h"
#include "turntable.h"
#include <stddef.h>

/* The largest record of any system, in words. */
typedef union {
    quad_words_t quad;
    balancer_words_t balancer;
    phone_words_t phone;
    turntable_words_t turntable;
} control_words_t;

#define CONTROL_RECORD_WORDS_MAX (sizeof(control_words_t) / 4U)

/* A whole controller of any system. Its words come first in each. */
typedef union {
    quad_t quad;
    balancer_t balancer;
    phone_t phone;
    turntable_t turntable;
} control_t;

/* State at the start of a run: the record is zero but for the start values of filters and controllers. */
void control_init(control_t *c, const control_params_t *p);

/* What ranges of single parameters cannot express: false if there is no such system, or if any sum of its
 * step could overflow. For the moment of commit, not for every step. */
bool control_params_valid(const control_params_t *p);

/* One step. raw: counts; setpoint: in the system's unit (quad: turn Q32). The result is in the words. */
void control_step(control_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                  int32_t setpoint);

/* The record of the last step, and its size in bytes, a multiple of 4. */
const void *control_words(const control_t *c);
size_t control_words_bytes(const control_params_t *p);

/* What is plausible for the system; NULL for one that moves nothing, of which nothing is checked. */
const plausibility_bounds_t *control_plausibility(const control_params_t *p);

/* True when a raw count of the last step was outside its range. */
bool control_saturated(const control_t *c, const control_params_t *p);

#endif
