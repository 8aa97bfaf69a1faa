/* The source of setpoints, watched while the actuator moves: one that is silent for SETPOINT_SILENCE_US
 * counts as lost, and the setpoint becomes 0. Part of a session; called by session.c and telemetry.c alone.
 */
#ifndef PLUMB_LINK_SETPOINT_H
#define PLUMB_LINK_SETPOINT_H

#include "session.h"

#define SETPOINT_SILENCE_US 200000U

/* To be called on every turn of the loop. */
void setpoint_poll(session_t *s, uint32_t now_us);

/* After a step in real time: SETPOINT_USED, when there is something to say of its setpoint. */
void setpoint_report(session_t *s);

#endif
