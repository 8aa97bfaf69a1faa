#include "setpoint.h"
#include "links.h"
#include "messages.h"

void setpoint_poll(session_t *s, uint32_t now_us) {
    if (s->setpoint_heard || !session_driving(s)) {
        s->setpoint_heard = false;
        s->setpoint_us = now_us;
    } else if (s->setpoint_turn_q32 != 0 && now_us - s->setpoint_us > SETPOINT_SILENCE_US) {
        s->setpoint_turn_q32 = 0;
        s->setpoint_timed_out = true;
        s->setpoint_waiting = true;
    }
}

void setpoint_report(session_t *s) {
    const message_setpoint_used_t used = {.step = s->step, .setpoint = s->setpoint_turn_q32};
    unsigned flags = 0;

    if (s->mode != SESSION_REALTIME || !s->setpoint_waiting) {
        return;
    }
    flags |= s->setpoint_timed_out ? MESSAGE_SETPOINT_USED_TIMED_OUT : 0U;
    flags |= s->setpoint_turn_q32 == s->setpoint_told_turn_q32 ? MESSAGE_SETPOINT_USED_REPEATED : 0U;
    s->setpoint_waiting = false;
    s->setpoint_timed_out = false;
    s->setpoint_told_turn_q32 = s->setpoint_turn_q32;
    links_answer(s, s->setpoint_source, message_setpoint_used_pack(&used), (uint8_t)flags);
}
