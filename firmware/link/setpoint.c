#include "setpoint.h"
#include "generated/messages.h"

void setpoint_begin(setpoint_t *s) {
    s->waiting = false;
    s->timed_out = false;
    s->turn_q32 = 0;
    s->told_turn_q32 = 0;
    s->armed = false;
    s->numbered = false;
}

/* A source that has heard of step n - 1, and not of step n, says n. A quarter turn of the numbers after the
 * last one that counted their order is not asked for any more: any other number that is not old is newer. */
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

void setpoint_receive(setpoint_t *s, int32_t turn_q32) {
    s->turn_q32 = turn_q32;
    s->heard = true;
    s->timed_out = false;
    s->waiting = true;
}

/* Whatever disarmed the board, its setpoint ends there. */
static void end_with_arming(setpoint_t *s, bool armed) {
    if (s->armed && !armed && s->turn_q32 != 0) {
        s->turn_q32 = 0;
        s->waiting = true;
    }
    s->armed = armed;
}

void setpoint_poll(setpoint_t *s, bool armed, bool driving, uint32_t now_us) {
    end_with_arming(s, armed);
    if (s->heard || !driving) {
        s->heard = false;
        s->heard_us = now_us;
    } else if (s->turn_q32 != 0 && now_us - s->heard_us > SETPOINT_SILENCE_US) {
        s->turn_q32 = 0;
        s->timed_out = true;
        s->waiting = true;
    }
}

void setpoint_report(setpoint_t *s, routing_t *routing, link_t source, uint16_t step) {
    const message_setpoint_used_t used = {.step = step, .setpoint = s->turn_q32};
    unsigned flags = 0;

    s->steps_since = (uint16_t)(s->steps_since + (s->steps_since < UINT16_MAX ? 1U : 0U));
    if (!s->waiting) {
        return;
    }
    flags |= s->timed_out ? MESSAGE_SETPOINT_USED_TIMED_OUT : 0U;
    flags |= s->turn_q32 == s->told_turn_q32 ? MESSAGE_SETPOINT_USED_REPEATED : 0U;
    s->waiting = false;
    s->timed_out = false;
    s->told_turn_q32 = s->turn_q32;
    routing_answer(routing, source, message_setpoint_used_pack(&used), (uint8_t)flags);
}
