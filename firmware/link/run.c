#include "run.h"
#include "links.h"
#include "messages.h"
#include "readiness.h"
#include "requests.h"
#include "telemetry.h"
#include <string.h>

/* SAMPLE and RAW carry the low six bits of their step number: four as the counter, two as flags. */
#define STEP6_MASK     63U
#define STEP6_SHIFT    4U
#define FLAG_STEP_HIGH 3U
#define NO_GAP         0xFFU
#define SAMPLE_ANY     0xFFU
#define RAW_B_NONE     0xFFU
#define RUN_TAG_MAX    15U /* four flags; 0: no run */

void run_begin(session_t *s, uint16_t run, run_links_t links) {
    s->mode = run == MESSAGE_RUN_BEGIN_RUN_LOCKSTEP ? SESSION_LOCKSTEP : SESSION_REALTIME;
    s->live = run == MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;
    s->begun = true;
    requests_withdraw_bootloader(s);
    s->step = 0;
    s->queue_in = 0;
    s->queue_out = 0;
    s->word_next = CONTROL_RECORD_WORDS_MAX;
    s->run_owner = links.owner;
    s->sample_source = links.samples;
    s->setpoint_source = links.setpoints;
    s->run_tag = (uint8_t)(s->run_tag < RUN_TAG_MAX ? s->run_tag + 1U : 1U);
    s->gap_ahead = NO_GAP;
    s->sample_expected = SAMPLE_ANY;
    s->raw_b_step6 = RAW_B_NONE;
    s->setpoint_waiting = false;
    s->setpoint_timed_out = false;
    s->setpoint_turn_q32 = 0;
    s->setpoint_told_turn_q32 = 0;
    s->held = (session_sample_t){0};
    s->stale = UINT16_MAX;
    control_init(s->control, &s->params->control);
    readiness_begin(s);
}

bool session_take_begin(session_t *s) {
    const bool begun = s->begun;

    s->begun = false;
    return begun;
}

/* ---- samples in ---- */

static void nack(session_t *s, const can_frame_t *f, uint16_t reason) {
    const message_nack_t m = {.request = f->id, .reason = reason, .detail = s->queue_in};

    links_reply(s, message_nack_pack(&m), e2e_counter(f));
}

static unsigned step6_of(const can_frame_t *f) {
    return e2e_counter(f) | ((e2e_flags(f) & FLAG_STEP_HIGH) << STEP6_SHIFT);
}

/* One report for one gap: the samples behind it are ever further ahead. Nearer again means that the host went
 * back to the step that was asked for, and that it is missing once more. */
static void tell_gap(session_t *s, const can_frame_t *f, unsigned ahead) {
    if (ahead <= s->gap_ahead) {
        s->link[s->asked].lost++;
        nack(s, f, MESSAGE_NACK_REASON_SEQUENCE);
    }
    s->gap_ahead = (uint8_t)ahead;
}

/* A sample that was run before: its STEP got lost on the way to the host, say it again. One that still waits
 * in the queue will be answered anyway. */
static void answer_again(session_t *s, uint16_t step) {
    const message_step_t m = {.step = step, .digest = s->buffers->digest[SESSION_SLOT(step)]};

    if ((uint16_t)(s->step - step - 1U) < SESSION_QUEUE_LENGTH) {
        links_reply(s, message_step_pack(&m), telemetry_step_flags(s, &s->link[s->asked], false));
    }
}

static void enqueue(session_t *s, const can_frame_t *f) {
    const message_sample_a_t m = message_sample_a_unpack(f);
    session_sample_t *const sample = &s->buffers->queue[SESSION_SLOT(s->queue_in)];

    if ((uint16_t)(s->queue_in - s->queue_out) >= SESSION_QUEUE_LENGTH) {
        nack(s, f, MESSAGE_NACK_REASON_QUEUE_FULL);
        return;
    }
    *sample =
        (session_sample_t){.raw = {m.raw_0, m.raw_1, m.raw_2}, .setpoint_turn_q32 = s->setpoint_turn_q32};
    if ((e2e_flags(f) & MESSAGE_SAMPLE_A_WITH_B) != 0) {
        memcpy(&sample->raw[3], s->raw_b, sizeof s->raw_b);
    }
    s->raw_b_step6 = RAW_B_NONE;
    s->gap_ahead = NO_GAP;
    s->sample_us = s->link[s->asked].heard_us;
    s->queue_in++;
}

static void sample_in_lockstep(session_t *s, const can_frame_t *f, bool incomplete) {
    const unsigned ahead = (step6_of(f) - s->queue_in) & STEP6_MASK;
    const bool without_setpoint =
        (e2e_flags(f) & MESSAGE_SAMPLE_A_WITH_SETPOINT) != 0 && !s->setpoint_waiting;

    if (ahead > STEP6_MASK - SESSION_QUEUE_LENGTH) {
        answer_again(s, (uint16_t)(s->queue_in + ahead - (STEP6_MASK + 1U)));
    } else if (ahead != 0 || incomplete || without_setpoint) {
        tell_gap(s, f, ahead);
    } else {
        s->setpoint_waiting = false;
        enqueue(s, f);
    }
}

/* A sensor board numbers its samples without knowing of the run: the first says where they are. */
static void sample_in_real_time(session_t *s, const can_frame_t *f, bool incomplete) {
    session_link_t *const l = &s->link[s->asked];
    const bool first = s->sample_expected > STEP6_MASK;

    l->lost = (uint16_t)(l->lost + (first ? 0U : (step6_of(f) - s->sample_expected) & STEP6_MASK));
    s->sample_expected = (uint8_t)((step6_of(f) + 1U) & STEP6_MASK);
    if (incomplete) {
        l->lost++;
    } else {
        enqueue(s, f);
    }
}

void run_on_sample_a(session_t *s, const can_frame_t *f) {
    const bool incomplete = (e2e_flags(f) & MESSAGE_SAMPLE_A_WITH_B) != 0 && s->raw_b_step6 != step6_of(f);

    if (s->mode == SESSION_IDLE || s->live) {
        nack(s, f, MESSAGE_NACK_REASON_NO_RUN);
    } else if (s->sample_source != s->asked) {
        nack(s, f, MESSAGE_NACK_REASON_OWNER);
    } else if (s->mode == SESSION_LOCKSTEP) {
        sample_in_lockstep(s, f, incomplete);
    } else {
        sample_in_real_time(s, f, incomplete);
    }
}

void run_on_sample_b(session_t *s, const can_frame_t *f) {
    const message_sample_b_t m = message_sample_b_unpack(f);

    if (s->sample_source != s->asked) { /* its SAMPLE_A is answered */
        return;
    }
    s->raw_b_step6 = (uint8_t)step6_of(f);
    s->raw_b[0] = m.raw_3;
    s->raw_b[1] = m.raw_4;
    s->raw_b[2] = m.raw_5;
}

/* Lockstep: one for a step that was taken in before comes from a repetition and must change nothing. */
void run_on_setpoint(session_t *s, const can_frame_t *f) {
    const message_setpoint_t m = message_setpoint_unpack(f);
    const bool due = m.step == s->queue_in;

    if (s->mode == SESSION_IDLE) {
        nack(s, f, MESSAGE_NACK_REASON_NO_RUN);
    } else if (s->setpoint_source != s->asked) {
        nack(s, f, MESSAGE_NACK_REASON_OWNER);
    } else if (e2e_flags(f) != s->run_tag) {
        nack(s, f, MESSAGE_NACK_REASON_RUN_TAG);
    } else if (s->mode == SESSION_REALTIME || due) {
        s->setpoint_turn_q32 = m.setpoint;
        s->setpoint_heard = true;
        s->setpoint_timed_out = false;
        s->setpoint_waiting = true;
    }
}

/* Samples that wait outlive their source: 16 of them are 1.6 s at the longest period. */
void run_poll(session_t *s, uint32_t now_us) {
    if (now_us - s->sample_us > ARMING_SAFE_US + s->params->period_us) {
        s->stale = UINT16_MAX;
    }
}

bool session_next_sample(session_t *s, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint_turn_q32) {
    const bool waiting = s->queue_in != s->queue_out;

    if (s->mode == SESSION_LOCKSTEP && !(waiting && s->word_next == CONTROL_RECORD_WORDS_MAX &&
                                         outbox_telemetry_fits(s->link[s->run_owner].outbox, s->selected))) {
        return false;
    }
    if (waiting) {
        s->held = s->buffers->queue[SESSION_SLOT(s->queue_out)];
        s->queue_out++;
        s->stale = 0;
    } else {
        s->starved++;
        s->stale = (uint16_t)(s->stale + (s->stale != UINT16_MAX ? 1U : 0U));
        if (s->params->control.system == CONTROL_TURNTABLE) { /* which knows what it is to have none */
            for (unsigned i = 0; i < CONTROL_RAW_MAX; i++) {
                s->held.raw[i] = PREFILTER_NO_SAMPLE;
            }
        }
    }
    memcpy(raw, s->held.raw, sizeof s->held.raw);
    *setpoint_turn_q32 = s->mode == SESSION_LOCKSTEP ? s->held.setpoint_turn_q32 : s->setpoint_turn_q32;
    return true;
}

int32_t session_setpoint(const session_t *s) {
    return s->setpoint_turn_q32;
}
