/* Readiness: turns the plausibility of the sensors into reasons against arming, and reports it to hosts.
 *
 * Only real-time runs of a system with bounds (control_system()->plausibility) are checked; else `bounds` is
 * NULL and nothing blocks. In lockstep nothing is checked, because nothing can be armed. */
#ifndef PLUMB_LINK_READINESS_H
#define PLUMB_LINK_READINESS_H

#include "generated/messages.h"
#include "generated/params.h"
#include "plumb/plausibility.h"

typedef struct {
    plumb_plausibility_t plausibility;
    uint16_t disarmed_by; /* PLUMB_PLAUSIBILITY_ACCEL and so on: the checks that failed last while armed */
} readiness_t;

/* Call at the start of a run. */
void readiness_begin(readiness_t *r);

/* Call after each step. words: its record. */
void readiness_step(readiness_t *r, const plumb_plausibility_bounds_t *bounds, const params_t *params,
                    const void *words, bool armed);

/* ARMING_BLOCK_IMPLAUSIBLE while a check fails, ARMING_BLOCK_NOT_READY while a condition for arming is
 * missing and the board is not armed. */
uint16_t readiness_blocked(const readiness_t *r, const plumb_plausibility_bounds_t *bounds, bool armed);

/* PLAUSIBILITY. */
message_plausibility_t readiness_message(const readiness_t *r, const plumb_plausibility_bounds_t *bounds);

#endif
