/* A run: samples in, step by step. Part of a session; called by session.c alone. */
#ifndef PLUMB_LINK_RUN_H
#define PLUMB_LINK_RUN_H

#include "session.h"

/* Which links a run belongs to. */
typedef struct {
    link_t owner;
    link_t samples;
    link_t setpoints;
} run_links_t;

/* Start anew: state, step number and digest, with the next run tag. run: one of MESSAGE_RUN_BEGIN_RUN_*. */
void run_begin(session_t *s, uint16_t run, run_links_t links);

/* To be called in every turn: notices that the source of injected samples has ceased. */
void run_poll(session_t *s, uint32_t now_us);

void run_on_sample_a(session_t *s, const can_frame_t *f);
void run_on_sample_b(session_t *s, const can_frame_t *f);
void run_on_setpoint(session_t *s, const can_frame_t *f);

#endif
