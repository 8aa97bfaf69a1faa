#include "setpoint.h"
#include "generated/messages.h"
#include <string.h>

#if CONTROL_COMMANDS_MAX > 0U
uint16_t setpoint_refused_set(const setpoint_t *s, uint16_t number, uint16_t next_step) {
    switch (command_set_state(&s->commands, number, next_step)) {
    case COMMAND_SET_WHOLE:
        return 0;
    case COMMAND_SET_BEYOND_LIMITS:
        return MESSAGE_NACK_REASON_RANGE;
    default:
        return MESSAGE_NACK_REASON_SEQUENCE;
    }
}
#endif

#if CONTROL_COMMANDS_MAX > 0U
void setpoint_of_board(setpoint_t *s, int32_t value, const int16_t *words, size_t count) {
    memcpy(s->commands.words, words, count * sizeof words[0]);
    s->waiting = s->waiting || s->value != value;
    s->value = value;
    s->received = true; /* on every turn: how old it is, the step knows */
}
#endif

static bool is_neutral(const setpoint_t *s) {
#if CONTROL_COMMANDS_MAX > 0U
    return s->value == 0 && command_set_is_neutral(&s->commands);
#else
    return s->value == 0;
#endif
}

static void become_neutral(setpoint_t *s) {
    s->value = 0;
    s->waiting = true;
#if CONTROL_COMMANDS_MAX > 0U
    command_set_neutral(&s->commands);
#endif
}

void setpoint_begin(setpoint_t *s, const control_system_t *system) {
#if CONTROL_COMMANDS_MAX > 0U
    command_set_begin(&s->commands, system);
#else
    (void)system;
#endif
    s->waiting = false;
    s->timed_out = false;
    s->value = 0;
    s->sent = 0;
    s->armed = false;
    s->numbered = false;
}

/* A source that has received STEP n - 1, and not STEP n, sends n. Numbers are compared with the last one that
 * counted, but only for a quarter of their range after it: later any number that is not too old, and not the
 * same, is newer. */
setpoint_age_t setpoint_age(const setpoint_t *s, uint16_t number, uint16_t next_step, uint32_t period_us) {
    const bool ordered = s->numbered && s->steps_since <= (uint16_t)INT16_MAX / 2U;

    if (s->numbered && number == s->number) {
        return SETPOINT_REPEATED;
    }
    if ((uint16_t)(next_step - number) >= SETPOINT_SILENCE_US / period_us) {
        return SETPOINT_OLD;
    }
    return ordered && (uint16_t)(number - s->number) > (uint16_t)INT16_MAX ? SETPOINT_OLD : SETPOINT_COUNTS;
}

void setpoint_number(setpoint_t *s, uint16_t number) {
    s->numbered = true;
    s->number = number;
    s->steps_since = 0;
}

void setpoint_receive(setpoint_t *s, int32_t value) {
#if CONTROL_COMMANDS_MAX > 0U
    command_set_apply(&s->commands);
#endif
    s->value = value;
    s->received = true;
    s->timed_out = false;
    s->waiting = true;
}

/* Disarming for any cause ends the setpoint. A setpoint that is still on its way carries at most the number
 * of the next step, because the source has received no later STEP, and does not count either. Commands return
 * to neutral, too, because a setpoint that is not 0 blocks arming. */
static void end_with_arming(setpoint_t *s, bool armed, uint16_t next_step) {
    if (s->armed && !armed) {
        setpoint_number(s, next_step);
        if (!is_neutral(s)) {
            become_neutral(s);
        }
    }
#if CONTROL_COMMANDS_MAX > 0U
    if (!s->armed && armed) {
        command_set_neutral(&s->commands);
    }
#endif
    s->armed = armed;
}

void setpoint_poll(setpoint_t *s, bool armed, bool driving, uint16_t next_step, uint32_t now_us) {
    end_with_arming(s, armed, next_step);
    if (s->received || !driving) {
        s->received = false;
        s->received_us = now_us;
    } else if (now_us - s->received_us > SETPOINT_SILENCE_US && !is_neutral(s)) {
        become_neutral(s);
        s->timed_out = true;
    }
}

void setpoint_report(setpoint_t *s, routing_t *routing, link_t source, uint16_t step) {
    const message_setpoint_used_t used = {.step = step, .setpoint = s->value};
    unsigned flags = 0;

    s->steps_since = (uint16_t)(s->steps_since + (s->steps_since < UINT16_MAX ? 1U : 0U));
    if (!s->waiting) {
        return;
    }
    flags |= s->timed_out ? MESSAGE_SETPOINT_USED_TIMED_OUT : 0U;
    flags |= s->value == s->sent ? MESSAGE_SETPOINT_USED_REPEATED : 0U;
    s->waiting = false;
    s->timed_out = false;
    s->sent = s->value;
    routing_answer(routing, source, message_setpoint_used_pack(&used), (uint8_t)flags);
}
