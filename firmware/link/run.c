#include "run.h"
#include "arming.h"
#include "generated/messages.h"
#include "plumb/prefilter.h"
#include <string.h>

/* SAMPLE carries the low six bits of its step number: four as the counter, two as flags. */
#define STEP6_MASK       63U
#define STEP6_SHIFT      4U
#define FLAG_STEP_HIGH   3U
#define NO_GAP           0xFFU
#define NO_STEP6         0xFFU
#define FRAME_COUNTS     3U     /* raw counts in a frame */
#define TAG_MAX          15U    /* four flags; 0: no run */
#define STEPS_MISSING    3U     /* a step is overdue after so many periods, */
#define STEPS_MISSING_US 20000U /* but not before this time */

void run_init(run_t *r, run_buffers_t *buffers, uint32_t random) {
    *r = (run_t){
        .queue = buffers->queue, .links = {LINK_NONE, LINK_UART, LINK_UART}, .tag = (uint8_t)(random >> 28)};
    injected_init(&r->injected, buffers->marks);
}

/* Forgets the frames of a sample that came before its SAMPLE_A. */
static void forget_more(run_t *r) {
    memset(r->more_step6, NO_STEP6, sizeof r->more_step6);
}

void run_begin(run_t *r, uint16_t run, run_links_t links, const control_system_t *system) {
    r->mode = run == MESSAGE_RUN_BEGIN_RUN_LOCKSTEP ? RUN_LOCKSTEP : RUN_REALTIME;
    r->live = run == MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;
    r->begun = true;
    r->stand_alone = links.owner == LINK_NONE;
    r->tag = (uint8_t)(r->tag < TAG_MAX ? r->tag + 1U : 1U);
    r->links = links;
    setpoint_begin(&r->setpoint, system);
    r->held = (run_sample_t){0};
    r->step = 0;
    r->queue_in = 0;
    r->queue_out = 0;
    r->gap_ahead = NO_GAP;
    injected_begin(&r->injected);
    forget_more(r);
}

void run_end(run_t *r) {
    r->stand_alone = false;
    r->mode = RUN_IDLE;
    r->live = false;
}

bool run_pop_begin(run_t *r) {
    const bool begun = r->begun;

    r->begun = false;
    return begun;
}

bool run_injected(const run_t *r) {
    return r->mode == RUN_REALTIME && !r->live;
}

void run_poll(run_t *r, uint32_t period_us, uint32_t now_us) {
    injected_poll(&r->injected, period_us, now_us);
}

/* Without steps the outputs would keep their last pulses, whatever the sensors say; a board that is not armed
 * would be "not ready" for ever. Until the turn that sets the timer, `begun` is set. */
bool run_step_overdue(run_t *r, uint32_t period_us, uint32_t now_us) {
    const uint32_t limit_us = STEPS_MISSING * period_us;

    if (r->mode != RUN_REALTIME || r->begun || r->step != r->step_seen) {
        r->step_seen = r->step;
        r->step_seen_us = now_us;
    }
    return now_us - r->step_seen_us > (limit_us > STEPS_MISSING_US ? limit_us : STEPS_MISSING_US);
}

/* ---- samples in ---- */

static void nack(const run_t *r, routing_t *routing, const request_t *q, uint16_t reason) {
    routing_nack(routing, q, reason, r->queue_in);
}

static unsigned step6_of(const can_frame_t *f) {
    return e2e_counter(f) | ((e2e_flags(f) & FLAG_STEP_HIGH) << STEP6_SHIFT);
}

/* Reports each gap once: the samples after a gap are further and further ahead of the missing step. A sample
 * that is not further ahead than the one before shows that the host has repeated the missing sample, and that
 * it was lost again. */
static void report_gap(run_t *r, routing_t *routing, const request_t *q, unsigned ahead) {
    if (ahead <= r->gap_ahead) {
        routing->link[q->link].lost++;
        nack(r, routing, q, MESSAGE_NACK_REASON_SEQUENCE);
    }
    r->gap_ahead = (uint8_t)ahead;
}

/* False when there is no room. */
static bool enqueue(run_t *r, routing_t *routing, const request_t *q) {
    const message_sample_a_t m = message_sample_a_unpack(q->frame);
    run_sample_t *const sample = &r->queue[RUN_SLOT(r->queue_in)];

    if ((uint16_t)(r->queue_in - r->queue_out) >= RUN_QUEUE_LENGTH) {
        nack(r, routing, q, MESSAGE_NACK_REASON_QUEUE_FULL);
        return false;
    }
    *sample = (run_sample_t){.raw = {m.raw_0, m.raw_1, m.raw_2}, .setpoint = r->setpoint.value};
    if ((e2e_flags(q->frame) & MESSAGE_SAMPLE_A_WITH_B) != 0) {
        memcpy(&sample->raw[FRAME_COUNTS], r->more, sizeof r->more);
    }
    setpoint_copy_commands(&r->setpoint, sample->raw);
    forget_more(r);
    r->gap_ahead = NO_GAP;
    r->queue_in++;
    return true;
}

/* True when the sample repeats *step, which was run already. A repeated sample that is still queued needs no
 * answer: its step will give one. */
static bool sample_in_lockstep(run_t *r, routing_t *routing, const request_t *q, bool incomplete,
                               uint16_t *step) {
    const unsigned ahead = (step6_of(q->frame) - r->queue_in) & STEP6_MASK;
    const bool without_setpoint =
        (e2e_flags(q->frame) & MESSAGE_SAMPLE_A_WITH_SETPOINT) != 0 && !r->setpoint.waiting;

    if (ahead > STEP6_MASK - RUN_QUEUE_LENGTH) {
        *step = (uint16_t)(r->queue_in + ahead - (STEP6_MASK + 1U));
        return (uint16_t)(r->step - *step - 1U) < RUN_QUEUE_LENGTH;
    }
    if (ahead != 0 || incomplete || without_setpoint) {
        report_gap(r, routing, q, ahead);
    } else {
        r->setpoint.waiting = false;
        (void)enqueue(r, routing, q);
    }
    return false;
}

/* A sensor board numbers its samples independently of the run. */
static void sample_in_real_time(run_t *r, routing_t *routing, const request_t *q, bool incomplete,
                                const params_t *params) {
    routing_link_t *const l = &routing->link[q->link];
    uint16_t lost;
    const bool counts =
        injected_counts(&r->injected, step6_of(q->frame), params->period_us, q->now_us, &lost);

    l->lost = (uint16_t)(l->lost + lost);
    if (!counts || incomplete) {
        l->lost++;
    } else if (enqueue(r, routing, q)) {
        injected_check(&r->injected, r->queue[RUN_SLOT(r->queue_in - 1U)].raw,
                       control_system(&params->control), params);
        return;
    }
    if (counts) {
        injected_spoilt(&r->injected);
    }
}

/* True when a frame that has to come before this SAMPLE_A is missing. */
static bool is_incomplete(const run_t *r, const can_frame_t *f, const params_t *params) {
    const unsigned frames =
        RUN_MORE_FRAMES == 1U ? 1U : control_system(&params->control)->counts / FRAME_COUNTS - 1U;

    if ((e2e_flags(f) & MESSAGE_SAMPLE_A_WITH_B) == 0) {
        return false;
    }
    for (unsigned i = 0; i < frames; i++) {
        if (r->more_step6[i] != step6_of(f)) {
            return true;
        }
    }
    return false;
}

bool run_on_sample_a(run_t *r, routing_t *routing, const request_t *q, const params_t *params,
                     uint16_t *step) {
    const bool incomplete = is_incomplete(r, q->frame, params);

    if (r->mode == RUN_IDLE || r->live) {
        nack(r, routing, q, MESSAGE_NACK_REASON_NO_RUN);
    } else if (r->links.samples != q->link) {
        nack(r, routing, q, MESSAGE_NACK_REASON_OWNER);
    } else if (r->mode == RUN_LOCKSTEP) {
        return sample_in_lockstep(r, routing, q, incomplete, step);
    } else {
        sample_in_real_time(r, routing, q, incomplete, params);
    }
    return false;
}

void run_on_more_counts(run_t *r, const request_t *q, unsigned index) {
    const message_sample_b_t m = message_sample_b_unpack(q->frame); /* all have this shape */
    int16_t *const counts = &r->more[FRAME_COUNTS * index];

    if (r->links.samples != q->link) { /* no NACK: the SAMPLE_A that follows gets it */
        return;
    }
    r->more_step6[index] = (uint8_t)step6_of(q->frame);
    counts[0] = m.raw_3;
    counts[1] = m.raw_4;
    counts[2] = m.raw_5;
}

#if CONTROL_COMMANDS_MAX > 0U
/* No NACK for one that cannot be used: the SETPOINT that follows gets it. */
void run_on_command(run_t *r, const request_t *q, unsigned index) {
    if (r->mode != RUN_IDLE && r->links.setpoints == q->link && e2e_flags(q->frame) == r->tag) {
        command_set_receive(&r->setpoint.commands, index, q->frame,
                            r->mode == RUN_LOCKSTEP ? r->queue_in : r->step);
    }
}
#endif

static void setpoint_in_real_time(run_t *r, routing_t *routing, const request_t *q, uint32_t period_us) {
    const message_setpoint_t m = message_setpoint_unpack(q->frame);
    const setpoint_age_t age = setpoint_age(&r->setpoint, m.step, r->step, period_us);

    const uint16_t refused = age == SETPOINT_COUNTS ? setpoint_refused(&r->setpoint, m.step, r->step) : 0U;

    if (refused != 0U) {
        routing_nack(routing, q, refused, r->step);
    } else if (age == SETPOINT_COUNTS) {
        setpoint_number(&r->setpoint, m.step);
        setpoint_receive(&r->setpoint, m.setpoint);
    } else if (age == SETPOINT_OLD) {
        routing_nack(routing, q, MESSAGE_NACK_REASON_SEQUENCE, r->step);
    }
}

/* In lockstep a setpoint for a step whose sample is queued already is a repetition, and must change nothing.
 */
void run_on_setpoint(run_t *r, routing_t *routing, const request_t *q, uint32_t period_us) {
    const message_setpoint_t m = message_setpoint_unpack(q->frame);

    if (r->mode == RUN_IDLE) {
        nack(r, routing, q, MESSAGE_NACK_REASON_NO_RUN);
    } else if (r->links.setpoints != q->link) {
        nack(r, routing, q, MESSAGE_NACK_REASON_OWNER);
    } else if (e2e_flags(q->frame) != r->tag) {
        nack(r, routing, q, MESSAGE_NACK_REASON_RUN_TAG);
    } else if (r->mode == RUN_REALTIME) {
        setpoint_in_real_time(r, routing, q, period_us);
    } else if (m.step == r->queue_in) {
        const uint16_t refused = setpoint_refused(&r->setpoint, m.step, r->queue_in);

        if (refused == 0U) {
            setpoint_receive(&r->setpoint, m.setpoint);
        } else {
            nack(r, routing, q, refused);
        }
    }
}

/* ---- samples out ---- */

void run_next_sample(run_t *r, bool mark_missing, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    if (run_sample_waits(r)) {
        r->held = r->queue[RUN_SLOT(r->queue_out)];
        r->queue_out++;
    } else {
        r->starved++;
        for (unsigned i = 0; mark_missing && i < PLUMB_RAW_MAX; i++) {
            r->held.raw[i] = INT16_MIN;
        }
    }
    memcpy(raw, r->held.raw, sizeof r->held.raw);
    if (r->mode != RUN_LOCKSTEP) {
        setpoint_copy_commands(&r->setpoint, raw);
    }
    *setpoint = r->mode == RUN_LOCKSTEP ? r->held.setpoint : r->setpoint.value;
}

void run_stepped(run_t *r, bool saturated) {
    r->saturated = (uint16_t)(r->saturated + saturated);
    r->step++;
}
