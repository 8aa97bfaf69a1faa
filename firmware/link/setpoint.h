/* Setpoint of the run, with a time-out of its source.
 *
 * While the actuator is driven, a source that is silent for SETPOINT_SILENCE_US counts as lost, and the
 * setpoint becomes 0; so it does when the board disarms. In real time a setpoint counts when it carries a
 * newer step number than the last one that counted and than the last step that was armed, and when the source
 * can have received that number within SETPOINT_SILENCE_US: a source that replays recorded setpoints counts
 * as silent. A setpoint is an integer of the system in use, in the unit and format of its system.toml. Times
 * are in us of the board's clock, modulo 2^32. */
#ifndef PLUMB_LINK_SETPOINT_H
#define PLUMB_LINK_SETPOINT_H

#include "command_set.h"
#include "routing.h"

#define SETPOINT_SILENCE_US 200000U

typedef struct {
    int32_t value;        /* in use; 0 at the start of a run */
    int32_t sent;         /* value of the last SETPOINT_USED */
    bool waiting;         /* lockstep: received for the next sample; real time: not reported yet */
    bool received;        /* one that counts was received since the last poll */
    bool timed_out;       /* set to 0 by the time-out, and not reported yet */
    bool armed;           /* at the last poll */
    bool numbered;        /* real time: one has counted, or an arming has ended, in this run */
    uint16_t number;      /* real time: step number of the last one that counted, or of the next step then */
    uint16_t steps_since; /* real time: steps since then, at most UINT16_MAX */
    uint32_t received_us; /* last poll at which one had been received, or the actuator was not driven */
#if CONTROL_COMMANDS_MAX > 0U
    command_set_t commands; /* that come with the setpoint, and share its age */
#endif
} setpoint_t;

/* Call at the start of a run of that system: the setpoint is 0, and nothing waits. */
void setpoint_begin(setpoint_t *s, const control_system_t *system);

typedef enum {
    SETPOINT_COUNTS,
    SETPOINT_REPEATED, /* the number of the last one that counted, or of the step that ended an arming */
    SETPOINT_OLD, /* an older number, or more than SETPOINT_SILENCE_US old, or one that is still to come */
} setpoint_age_t;

#if CONTROL_COMMANDS_MAX > 0U
/* Use the setpoint and the first `count` words of commands of a source on the board. Call on every whole turn
 * of the loop, after setpoint_poll(): they replace what arming and time-outs have set. */
void setpoint_of_board(setpoint_t *s, int32_t value, const int16_t *words, size_t count);

uint16_t setpoint_refused_set(const setpoint_t *s, uint16_t number, uint16_t next_step);
#endif

/* Write the commands in use behind the raw counts. */
static inline void setpoint_copy_commands(const setpoint_t *s, int16_t raw[PLUMB_RAW_MAX]) {
#if CONTROL_COMMANDS_MAX > 0U
    command_set_copy(&s->commands, raw);
#else
    (void)s, (void)raw;
#endif
}

/* How a step number that came with a setpoint in real time compares. next_step: of the run. */
setpoint_age_t setpoint_age(const setpoint_t *s, uint16_t number, uint16_t next_step, uint32_t period_us);

/* Note the number of a setpoint that counts: only newer ones count from here on. */
void setpoint_number(setpoint_t *s, uint16_t number);

/* Reason (MESSAGE_NACK_REASON_*) why the setpoint of step `number` cannot be used with the commands that came
 * before it; 0: it can. next_step: of the run. */
static inline uint16_t setpoint_refused(const setpoint_t *s, uint16_t number, uint16_t next_step) {
#if CONTROL_COMMANDS_MAX > 0U
    return setpoint_refused_set(s, number, next_step);
#else
    (void)s, (void)number, (void)next_step;
    return 0;
#endif
}

/* Handle a setpoint that counts from the source of this run. */
void setpoint_receive(setpoint_t *s, int32_t value);

/* Call on every whole turn of the loop: applies the time-out and the end of arming. driving: the actuator may
 * move. next_step: of the run. */
void setpoint_poll(setpoint_t *s, bool armed, bool driving, uint16_t next_step, uint32_t now_us);

/* Call after a step in real time: sends SETPOINT_USED to the source's link when a setpoint was received,
 * timed out or ended since the last report. step: number of that step. */
void setpoint_report(setpoint_t *s, routing_t *routing, link_t source, uint16_t step);

#endif
