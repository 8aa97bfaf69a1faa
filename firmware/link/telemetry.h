/* What a step says: its digest always, and of its words those that were selected. The last part of a session;
 * called by session.c and run.c alone. */
#ifndef PLUMB_LINK_TELEMETRY_H
#define PLUMB_LINK_TELEMETRY_H

#include "session.h"

/* Choose what a step sends: bank 0 frames, 1.. words. Frames that the system does not have and words beyond
 * its record are left out. */
void telemetry_select(session_t *s, uint16_t bank, uint32_t mask);

/* Nothing but STEP: before the first SELECT, and when the system changes. */
void telemetry_select_nothing(session_t *s);

/* What is left of the last step's words, as there is room: a lockstep run waits for it with its next step. */
void telemetry_send_words(session_t *s);

/* Flags of STEP on a link. saturated: a raw count of that step was outside its range. */
uint8_t telemetry_step_flags(const session_t *s, const session_link_t *l, bool saturated);

#endif
