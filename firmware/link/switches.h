/* The arm switch of the board, or the pilot's by his receiver: they arm, disarm, and begin a run without a
 * host. */
#ifndef PLUMB_LINK_SWITCHES_H
#define PLUMB_LINK_SWITCHES_H

#include "session_state.h"

/* Follow the pilot's switch, or that of the board; closed: the board's. Call on every whole turn. */
void session_follow_switches(session_t *s, bool closed, uint32_t now_us);

#endif
