/* What the plausibility of the sensors means for arming, and how a host hears of it. */
#ifndef PLUMB_LINK_READINESS_H
#define PLUMB_LINK_READINESS_H

#include "session.h"

/* At the start of a run. */
void readiness_begin(session_t *s);

/* After a step. In lockstep nothing is checked, because nothing can be armed. */
void readiness_stepped(session_t *s);

/* ARMING_BLOCK_IMPLAUSIBLE while a check fails, ARMING_BLOCK_NOT_READY while a condition for arming is
 * missing and nothing is armed; 0 outside a run in real time. */
uint16_t readiness_blocked(const session_t *s);

/* PLAUSIBILITY over one link. */
void readiness_send(session_t *s, link_t link);

#endif
