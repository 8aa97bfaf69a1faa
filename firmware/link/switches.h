/* The arm switch of the board, or the pilot's by his receiver: they arm, disarm, and begin a run without a
 * host. */
#ifndef PLUMB_LINK_SWITCHES_H
#define PLUMB_LINK_SWITCHES_H

#include "session_state.h"

#define SESSION_ALONE_US 1000000U /* without a run for so long the board begins one for its pilot */

#if USED_RECEIVER
/* Handle bytes of the receiver. In a run in real time of a system that has one, while the parameter
 * `receiver` is not 0, they set setpoint and commands, and no host does. Its switch arms (follow_pilot()).
 */
void session_receive_sticks(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* The same for the edges of its pulse train (ppm.h), also when none have come. Only one of the two counts, by
 * the parameter. */
void session_receive_edges(session_t *s, const uint16_t *stamps_us, size_t count, uint32_t now_us);

/* The sticks of a run in real time are the receiver's. Call after every poll of what they reached. */
void session_take_sticks(session_t *s);
#endif

/* Follow the pilot's switch, or that of the board; closed: the board's. Call on every whole turn. */
void session_follow_switches(session_t *s, bool closed, uint32_t now_us);

/* End the run that the board has begun for a pilot, unless it is armed: a host asks for something that waits
 * for the end of a run. */
void session_end_alone(session_t *s, uint32_t now_us);

#endif
