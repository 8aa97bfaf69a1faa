/* Run: queue of injected samples, setpoint, and step counter.
 *
 * Lockstep: each sample of the host makes one step. A sample out of order is refused; a repeated sample whose
 * step was run already gets its STEP again. Real time: the board's timer makes the steps; a step without a
 * new sample uses the last one again and is counted as starved. A run belongs to the link that began it;
 * samples and setpoints may come from the other link. Times are in us of the board's clock; differences are
 * taken modulo 2^32. */
#ifndef PLUMB_LINK_RUN_H
#define PLUMB_LINK_RUN_H

#include "injected.h"
#include "setpoint.h"

#define RUN_QUEUE_LENGTH 16U /* samples in flight; a power of two */
#define RUN_SLOT(step)   ((step) & (RUN_QUEUE_LENGTH - 1U))
#define RUN_MORE_FRAMES  (CONTROL_COUNTS_MAX / 3U - 1U) /* of a sample, besides SAMPLE_A */

typedef enum { RUN_IDLE = 0, RUN_LOCKSTEP = 1, RUN_REALTIME = 2 } run_mode_t;

/* Links of a run. */
typedef struct {
    link_t owner;     /* began the run: it alone may arm, its keep-alive holds the board armed, and it paces
                         lockstep. LINK_NONE: the arm switch began it */
    link_t samples;   /* it alone may send this run's samples */
    link_t setpoints; /* it alone may send this run's setpoints. LINK_NONE: no host, the receiver sets them */
} run_links_t;

/* One injected sample with its setpoint. */
typedef struct {
    int16_t raw[PLUMB_RAW_MAX];
    int32_t setpoint; /* in the unit and format of its system.toml */
} run_sample_t;

/* Outside the memory that has a check word: its contents come from a host and are checked when they are used.
 */
typedef struct {
    run_sample_t queue[RUN_QUEUE_LENGTH];
    uint8_t marks[INJECTED_NUMBERS];
} run_buffers_t;

typedef struct {
    run_sample_t *queue; /* RUN_QUEUE_LENGTH samples */
    injected_t injected;
    run_mode_t mode;
    bool live;        /* real time on the board's own sensors */
    bool begun;       /* set by run_begin(), cleared by run_pop_begin() */
    bool stand_alone; /* the arm switch began this run */
    uint8_t tag;      /* 1 to 15, of this run or the last one; setpoints must carry it */
    run_links_t links;
    setpoint_t setpoint;
    run_sample_t held;     /* the sample of the last step */
    uint16_t step;         /* number of the next step */
    uint16_t step_seen;    /* number of the next step when it last changed */
    uint32_t step_seen_us; /* when that was */
    uint16_t queue_in;     /* samples queued so far; in lockstep the number of the next one */
    uint16_t queue_out;    /* samples used so far */
    uint16_t saturated;    /* steps with a raw count outside its range, modulo 2^16 */
    uint16_t starved;      /* real-time steps without a new sample, modulo 2^16 */
    uint8_t gap_ahead;     /* how far the last sample was ahead of the missing one; 0xFF: none is missing */
    uint8_t more_step6[RUN_MORE_FRAMES]; /* low six bits of the number that each frame of `more` belongs to;
                                            above 63: none */
    int16_t more[3U * RUN_MORE_FRAMES];  /* counts of SAMPLE_B and the frames after it */
} run_t;

/* No run. buffers: in memory that the caller keeps. random: sets the first tag, so
 * that a run after a reset does not get the tag of the run before it. */
void run_init(run_t *r, run_buffers_t *buffers, uint32_t random);

/* Start anew with step 0 and the next tag. run: one of MESSAGE_RUN_BEGIN_RUN_*; system: the one in use. */
void run_begin(run_t *r, uint16_t run, run_links_t links, const control_system_t *system);
void run_end(run_t *r);

/* True once after a run began. */
bool run_pop_begin(run_t *r);

/* Call on every whole turn of the loop: detects that the source of injected samples has gone silent. */
void run_poll(run_t *r, uint32_t period_us, uint32_t now_us);

/* True while a step is overdue: the last step of a run in real time, or its begin, is more than 3 periods and
 * more than 20 ms ago. Call on every whole turn of the loop, before run_pop_begin(). */
bool run_step_overdue(run_t *r, uint32_t period_us, uint32_t now_us);

/* True during a run in real time on injected samples. */
bool run_injected(const run_t *r);

/* Handle SAMPLE_A, the other frames of a sample (index 0: SAMPLE_B) and SETPOINT of a link; a frame that
 * cannot be used is answered by NACK. run_on_sample_a() returns true for a repeated sample whose step was run
 * already, because its STEP got lost on the way to the host: *step is the number of that step, one of the
 * last RUN_QUEUE_LENGTH. */
bool run_on_sample_a(run_t *r, routing_t *routing, const request_t *q, const params_t *params,
                     uint16_t *step);
void run_on_more_counts(run_t *r, const request_t *q, unsigned index);
void run_on_setpoint(run_t *r, routing_t *routing, const request_t *q, uint32_t period_us);

#if CONTROL_COMMANDS_MAX > 0U
/* Handle frame `index` of a set of commands, which the SETPOINT of its step completes. */
void run_on_command(run_t *r, const request_t *q, unsigned index);
#endif

/* The link whose host paces the steps; LINK_NONE when none does. */
static inline link_t run_pacer(const run_t *r) {
    return r->mode == RUN_LOCKSTEP ? r->links.owner : LINK_NONE;
}

/* True when an injected sample is queued. */
static inline bool run_sample_waits(const run_t *r) {
    return r->queue_in != r->queue_out;
}

/* Take the sample of the next step: the oldest queued one, else the last one again. mark_missing: a step
 * without a new sample gets counts of INT16_MIN instead. */
void run_next_sample(run_t *r, bool mark_missing, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint);

/* Call after each step. saturated: a raw count was outside its range. */
void run_stepped(run_t *r, bool saturated);

#endif
