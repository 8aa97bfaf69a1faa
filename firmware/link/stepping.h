/* A run, from its beginning from step to step. */
#ifndef PLUMB_LINK_STEPPING_H
#define PLUMB_LINK_STEPPING_H

#include "session_state.h"

void session_begin_run(session_t *s, uint16_t run, run_links_t links); /* run: MESSAGE_RUN_BEGIN_RUN_* */

/* The inputs of the next step. Live: raw holds the counts of the sensors, the setpoint and the commands are
 * added. Lockstep: false until a sample is waiting and its replies have room. Real time, injected: call on
 * every tick; without a new sample the last one is held and counted. */
bool session_take_inputs(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint);

/* Call after control_step(): sends the digest and the selected words. */
void session_stepped(session_t *s);

/* Send the selected words of the last step that wait for room. */
void session_send_words(session_t *s);

/* Send the STEP of one of the last RUN_QUEUE_LENGTH steps again. */
void session_repeat_step(session_t *s, const request_t *q, uint16_t step);

#endif
