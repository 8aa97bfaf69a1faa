/* Readiness: what the plausibility of the sensors means for arming, and how a host hears of it.
 *
 * Checked are real-time runs of a system that has bounds (control_system()->plausibility); elsewhere bounds
 * is NULL and nothing blocks. In lockstep nothing is checked, because nothing can be armed. */
#ifndef PLUMB_LINK_READINESS_H
#define PLUMB_LINK_READINESS_H

#include "core/plausibility.h"
#include "generated/params.h"
#include "outbox.h"

typedef struct {
    plausibility_t plausibility;
    uint16_t disarmed_by; /* PLAUSIBILITY_ACCEL and so on: what failed at the last step of an armed board */
} readiness_t;

/* At the start of a run. */
void readiness_begin(readiness_t *r);

/* After a step. words: its record. */
void readiness_step(readiness_t *r, const plausibility_bounds_t *bounds, const params_t *params,
                    const void *words, bool armed);

/* ARMING_BLOCK_IMPLAUSIBLE while a check fails, ARMING_BLOCK_NOT_READY while a condition for arming is
 * missing and the board is not armed. */
uint16_t readiness_blocked(const readiness_t *r, const plausibility_bounds_t *bounds, bool armed);

/* PLAUSIBILITY over one link. */
void readiness_send(const readiness_t *r, const plausibility_bounds_t *bounds, outbox_t *outbox);

#endif
