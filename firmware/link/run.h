/* A run: samples in, step by step, digests and words out. The session's other half; called by session.c
 * alone. */
#ifndef PLUMB_LINK_RUN_H
#define PLUMB_LINK_RUN_H

#include "session.h"

/* Start anew: state, step number and digest. run: one of MESSAGE_RUN_BEGIN_RUN_*. */
void run_begin(session_t *s, uint16_t run);

/* Choose what a step sends: bank 0 frames, 1.. words. */
void run_select(session_t *s, uint16_t bank, uint32_t mask);

/* What is left of the last step's words, as there is room: a lockstep run waits for it with its next step. */
void run_send_words(session_t *s);

void run_on_sample_a(session_t *s, const can_frame_t *f);
void run_on_sample_b(session_t *s, const can_frame_t *f);
void run_on_setpoint(session_t *s, const can_frame_t *f);

#endif
