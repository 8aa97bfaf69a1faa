/* Run: the samples and setpoints that come in, in order, and the number of the step they are for.
 *
 * Lockstep: each sample of the host makes one step; a sample out of order is refused, one that was run before
 * is answered again. Real time: the board's timer makes the steps; a step without a new sample holds the last
 * one and counts it. A run belongs to the link that began it; samples and setpoints may come from the other
 * link. Times are in us of the board's clock; differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_RUN_H
#define PLUMB_LINK_RUN_H

#include "generated/control_params.h"
#include "setpoint.h"

#define RUN_QUEUE_LENGTH 16U /* samples in flight; a power of two */
#define RUN_SLOT(step)   ((step) & (RUN_QUEUE_LENGTH - 1U))

typedef enum { RUN_IDLE = 0, RUN_LOCKSTEP = 1, RUN_REALTIME = 2 } run_mode_t;

/* Which links a run belongs to. */
typedef struct {
    link_t owner;     /* began the run: it alone may arm, its keep-alive holds the board armed, and it paces
                         lockstep. LINK_NONE: the arm switch began it */
    link_t samples;   /* it alone may send this run's samples */
    link_t setpoints; /* it alone may send this run's setpoints */
} run_links_t;

/* One sample as injected, with its setpoint. */
typedef struct {
    int16_t raw[CONTROL_RAW_MAX];
    int32_t setpoint_turn_q32;
} run_sample_t;

typedef struct {
    run_sample_t *queue; /* RUN_QUEUE_LENGTH of them; they decide no pulse before they are a step's */
    run_mode_t mode;
    bool live;        /* real time on the board's own sensors */
    bool begun;       /* until run_pop_begin() */
    bool stand_alone; /* the arm switch began this run */
    uint8_t tag;      /* 1 to 15, of this run or the last: its setpoints carry it */
    run_links_t links;
    setpoint_t setpoint;
    run_sample_t held;     /* the sample of the last step */
    uint16_t step;         /* number of the next step */
    uint16_t step_seen;    /* at the last poll of an armed board, */
    uint32_t step_seen_us; /* and when it was new */
    uint16_t queue_in;     /* samples queued so far; in lockstep the number of the next one */
    uint16_t queue_out;    /* samples used so far */
    uint16_t saturated;    /* steps with a clamped value, modulo 2^16 */
    uint16_t starved;      /* real-time steps without a new sample, modulo 2^16 */
    uint16_t stale;        /* real-time steps since the last injected sample; all ones: none came in this run,
                              or its source has ceased */
    uint32_t sample_us;    /* arrival of the last injected sample */
    uint8_t gap_ahead;     /* how far the last sample was ahead of the missing one; 0xFF: none is missing */
    uint8_t sample_expected; /* real time: low six bits of the next sample's number; above 63: any */
    uint8_t raw_b_step6;     /* low six bits of the number raw_b belongs to; above 63: none */
    int16_t raw_b[3];
} run_t;

/* Idle. queue: RUN_QUEUE_LENGTH samples, kept by the caller. random: any word; tags begin there, so that a
 * run after a reset does not get the tag of the run before. */
void run_init(run_t *r, run_sample_t *queue, uint32_t random);

/* Start anew with step 0 and the next tag. run: one of MESSAGE_RUN_BEGIN_RUN_*. */
void run_begin(run_t *r, uint16_t run, run_links_t links);
void run_end(run_t *r);

/* True once after a run began. */
bool run_pop_begin(run_t *r);

/* Call on every turn of the loop: notices that the source of injected samples has ceased. */
void run_poll(run_t *r, uint32_t period_us, uint32_t now_us);

/* True while a step is overdue: armed, and none for STEPS_MISSING periods and 20 ms. Call on every turn of
 * the loop. */
bool run_step_overdue(run_t *r, bool armed, uint32_t period_us, uint32_t now_us);

/* True while the injected samples of a real-time run are too old to control by. */
bool run_samples_stale(const run_t *r, uint32_t period_us);

/* SAMPLE_A, SAMPLE_B and SETPOINT of a link; what cannot be used is answered by NACK. run_on_sample_a() is
 * true when the sample was run before, so that its STEP got lost on the way to the host: *step is its number,
 * one of the last RUN_QUEUE_LENGTH. */
bool run_on_sample_a(run_t *r, routing_t *routing, const request_t *q, uint16_t *step);
void run_on_sample_b(run_t *r, const request_t *q);
void run_on_setpoint(run_t *r, routing_t *routing, const request_t *q);

/* The link whose host paces the steps; LINK_NONE when none does. */
static inline link_t run_pacer(const run_t *r) {
    return r->mode == RUN_LOCKSTEP ? r->links.owner : LINK_NONE;
}

/* True when an injected sample waits. */
static inline bool run_sample_waits(const run_t *r) {
    return r->queue_in != r->queue_out;
}

/* The sample of the next step: the oldest that waits, else the last one again. mark_missing: a step without a
 * new sample gets INT16_MIN in all places instead. */
void run_next_sample(run_t *r, bool mark_missing, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint_turn_q32);

/* After a step. */
void run_stepped(run_t *r, bool saturated);

#endif
