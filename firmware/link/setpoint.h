/* Setpoint of the run, with a time-out of its source.
 *
 * While the actuator is driven, a source that is silent for SETPOINT_SILENCE_US counts as lost, and the
 * setpoint becomes 0; so it does when the board disarms. Setpoints are in the system's unit, turn Q32 for an
 * angle. Times are in us of the board's clock, modulo 2^32. */
#ifndef PLUMB_LINK_SETPOINT_H
#define PLUMB_LINK_SETPOINT_H

#include "routing.h"

#define SETPOINT_SILENCE_US 200000U

typedef struct {
    int32_t turn_q32;      /* in use; 0 at the start of a run */
    int32_t told_turn_q32; /* value of the last SETPOINT_USED */
    bool waiting;          /* lockstep: received for the next sample; real time: not reported yet */
    bool heard;            /* one was received since the last poll */
    bool timed_out;        /* set to 0 by the time-out, and not reported yet */
    bool armed;            /* at the last poll */
    uint32_t heard_us;     /* last poll at which one had been received, or the actuator was not driven */
} setpoint_t;

/* Call at the start of a run: the setpoint is 0, and nothing waits. */
void setpoint_begin(setpoint_t *s);

/* Handle a setpoint from the source of this run. */
void setpoint_receive(setpoint_t *s, int32_t turn_q32);

/* Call on every turn of the loop: applies the time-out and the end of arming. driving: the actuator may
 * move. */
void setpoint_poll(setpoint_t *s, bool armed, bool driving, uint32_t now_us);

/* Call after a step in real time: sends SETPOINT_USED to the source's link when a setpoint was received,
 * timed out or ended since the last report. step: number of that step. */
void setpoint_report(setpoint_t *s, routing_t *routing, link_t source, uint16_t step);

#endif
