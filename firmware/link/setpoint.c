#include "setpoint.h"
#include "generated/messages.h"

void setpoint_begin(setpoint_t *s) {
    s->waiting = false;
    s->timed_out = false;
    s->turn_q32 = 0;
    s->told_turn_q32 = 0;
    s->armed = false;
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
