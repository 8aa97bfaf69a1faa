#include "pilot.h"
#include "app/board_receiver.h"
#include "arming_reasons.h"
#include "stepping.h"

/* Only one of the two lines counts, by the parameter. */
static void receive_sticks(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us) {
    s->receiver.by_sticks = s->params->receiver % 2U == 0U;
    if (s->params->receiver < RECEIVER_PPM) {
        receiver_push(&s->receiver, &s->buffers->crsf, bytes, count, now_us);
    }
}

/* Also when no edges have come. */
static void receive_edges(session_t *s, const uint16_t *stamps_us, size_t count, uint32_t now_us) {
    if (ppm_follow(&s->buffers->ppm, stamps_us, count, now_us) && s->params->receiver >= RECEIVER_PPM) {
        receiver_pulses(&s->receiver, s->buffers->ppm.pulse_us, now_us);
    }
}

void session_receive_pilot(session_t *s, uint32_t now_us) {
    uint8_t bytes[32];
    uint16_t stamps_us[16];
    size_t count;

    s->readiness.outside = 0; /* of this turn: what the battery lacks, then what the pilot does */
    do {
        count = board_receiver_read(bytes, sizeof bytes);
        receive_sticks(s, bytes, count, now_us);
    } while (count == sizeof bytes);
    count = board_receiver_edges(stamps_us, sizeof stamps_us / sizeof stamps_us[0]);
    receive_edges(s, stamps_us, count, now_us);
}

void session_take_sticks(session_t *s) {
    if (s->run.mode == RUN_REALTIME && session_has_receiver(s)) {
        const receiver_t *const r = &s->receiver;

        setpoint_of_board(&s->run.setpoint, r->throttle_q15, r->words, RECEIVER_WORDS);
    }
}

/* What keeps a board that is not armed from being armed, on the side of the pilot: READINESS_. */
static uint16_t pilot_missing(const session_t *s, bool present, bool locked) {
    unsigned missing = locked ? READINESS_LOCKED : 0U;

    missing |= s->params->calibrated != 0U ? 0U : READINESS_RAW;
    if (!present) {
        missing |= READINESS_RECEIVER;
    } else if (arming_switch_used_up(&s->arming)) {
        missing |= READINESS_SWITCH_ON;
    }
    return (uint16_t)(arming_armed(&s->arming) ? 0U : missing);
}

/* The switch of the pilot arms and disarms, in any run in real time. A run begins without a host, too,
 * because the step has to see the switch off before it is on. While no frame of the receiver comes an armed
 * board leaves the rotors to the step; a board that is not armed has to see the switch off once more. Off is
 * seen when the frames say so, at any rate of frames; an armed board obeys the switch as the step reads it.
 */
void session_follow_pilot(session_t *s, bool locked, uint32_t now_us) {
    const bool present = receiver_present(&s->receiver, now_us);
    const bool on = receiver_rotors_on(&s->receiver);
    const bool read = on || receiver_rotors_off(&s->receiver) || arming_armed(&s->arming);

    if (present && read) {
        (void)arming_switch(&s->arming, on, now_us);
    } else if (!present && !arming_armed(&s->arming)) {
        arming_switch_unread(&s->arming);
    }
    s->readiness.outside |= pilot_missing(s, present, locked);
    if (s->arming.switch_trying) {
        arming_try_switch(&s->arming, session_arming_blocked(s, s->run.links.owner), ARMING_SWITCH_TRY_US,
                          session_hold_us(s), now_us);
    }
#if USED_WHEELS
    /* A fall, a break, and why it was disarmed are kept until the run ends: when the pilot has switched off.
     */
    const bool kept =
        (s->readiness.stopped & READINESS_FALLEN) != 0U || (s->status.faults & BOARD_FAULT_BRIDGE) != 0U;
    if (kept && s->run.stand_alone && !arming_armed(&s->arming) && receiver_rotors_off(&s->receiver)) {
        run_end(&s->run);
    }
#endif
    if (s->run.mode != RUN_IDLE || s->bootloader_asked || !session_actuator_present(s)) {
        s->busy_us = now_us;
    } else if (now_us - s->busy_us >= SESSION_ALONE_US) {
        session_begin_run(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE,
                          (run_links_t){LINK_NONE, LINK_NONE, LINK_NONE});
    }
}

void session_end_alone(session_t *s, uint32_t now_us) {
    if (session_has_receiver(s) && s->run.stand_alone && !arming_armed(&s->arming)) {
        run_end(&s->run);
    }
    s->busy_us = now_us;
}

uint32_t session_pilot(const session_t *s) {
    return s->params->receiver << 1 | (session_has_receiver(s) ? 1U : 0U);
}

void session_pilot_changed(session_t *s, uint32_t before) {
    if (session_pilot(s) != before) {
        /* a pilot's from now on, or the board's, or of another line */
        s->receiver = (receiver_t){0};
        arming_switch_unread(&s->arming);
    }
}
