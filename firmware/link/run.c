#include "run.h"
#include "../core/digest.h"
#include "links.h"
#include "messages.h"
#include <string.h>

/* SAMPLE and RAW carry the low six bits of their step number: four as the counter, two as flags. */
#define STEP6_MASK     63U
#define STEP6_SHIFT    4U
#define FLAG_STEP_HIGH 3U
#define NO_GAP         0xFFU
#define SAMPLE_ANY     0xFFU
#define RAW_B_NONE     0xFFU

#define QUEUE_SLOT(step) ((step) & (SESSION_QUEUE_LENGTH - 1U))

/* Bits of SELECT bank 0. */
#define FRAME_RAW_A    0x01U
#define FRAME_RAW_B    0x02U
#define FRAME_ANGLE    0x04U
#define FRAME_BIAS     0x08U
#define FRAME_RATE     0x10U
#define FRAME_MEASURED 0x20U
#define FRAME_COMMAND  0x40U
#define FRAMES_ALL     0x7FU

/* Raw counts outside their range; a limited command is no such thing. */
#define FLAGS_SATURATED                                                                                      \
    (CONTROL_FLAG_GYRO_CLAMPED | CONTROL_FLAG_ACCEL_Y_CLAMPED | CONTROL_FLAG_ACCEL_Z_CLAMPED)

void run_begin(session_t *s, uint16_t run) {
    s->mode = run == MESSAGE_RUN_BEGIN_RUN_LOCKSTEP ? SESSION_LOCKSTEP : SESSION_REALTIME;
    s->live = run == MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;
    s->begun = true;
    s->step = 0;
    s->queue_in = 0;
    s->queue_out = 0;
    s->word_next = SESSION_RECORD_WORDS;
    s->run_by = s->asked;
    s->gap_ahead = NO_GAP;
    s->sample_expected = SAMPLE_ANY;
    s->raw_b_step6 = RAW_B_NONE;
    s->setpoint_waiting = false;
    s->setpoint_turn_q32 = 0;
    s->held = (session_sample_t){0};
    s->stale = UINT16_MAX;
    control_init(s->control, &s->params->control);
}

bool session_take_begin(session_t *s) {
    const bool begun = s->begun;

    s->begun = false;
    return begun;
}

static uint16_t bits_set(uint32_t mask) {
    uint16_t count = 0;

    for (; mask != 0; mask &= mask - 1U) {
        count++;
    }
    return count;
}

void run_select(session_t *s, uint16_t bank, uint32_t mask) {
    if (bank == 0) {
        s->frames_mask = mask & FRAMES_ALL;
        s->selected = (uint16_t)(1U + bits_set(s->frames_mask)); /* and STEP */
    } else {
        s->words_mask[bank - 1U] = mask;
    }
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

static uint8_t step_flags(const session_t *s, const session_link_t *l, bool saturated) {
    unsigned flags = 0;

    flags |= s->arming.armed ? MESSAGE_STEP_ARMED : 0U;
    flags |= s->live ? MESSAGE_STEP_LIVE : 0U;
    flags |= saturated ? MESSAGE_STEP_SATURATED : 0U;
    flags |= l->dropped_told != l->outbox.dropped ? MESSAGE_STEP_DROPPED : 0U;
    return (uint8_t)flags;
}

/* A sample that was run before: its STEP got lost on the way to the host, say it again. One that still waits
 * in the queue will be answered anyway. */
static void answer_again(session_t *s, uint16_t step) {
    const message_step_t m = {.step = step, .digest = s->digest[QUEUE_SLOT(step)]};

    if ((uint16_t)(s->step - step - 1U) < SESSION_QUEUE_LENGTH) {
        links_reply(s, message_step_pack(&m), step_flags(s, &s->link[s->asked], false));
    }
}

static void enqueue(session_t *s, const can_frame_t *f) {
    const message_sample_a_t m = message_sample_a_unpack(f);
    session_sample_t *const sample = &s->queue[QUEUE_SLOT(s->queue_in)];

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

    if (s->mode == SESSION_IDLE || s->live || (s->mode == SESSION_LOCKSTEP && s->run_by != s->asked)) {
        nack(s, f, MESSAGE_NACK_REASON_NO_RUN);
    } else if (s->mode == SESSION_LOCKSTEP) {
        sample_in_lockstep(s, f, incomplete);
    } else {
        sample_in_real_time(s, f, incomplete);
    }
}

void run_on_sample_b(session_t *s, const can_frame_t *f) {
    const message_sample_b_t m = message_sample_b_unpack(f);

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
    } else if (s->mode == SESSION_REALTIME || due) {
        s->setpoint_turn_q32 = m.setpoint;
        s->setpoint_by = s->asked;
        s->setpoint_waiting = true;
    }
}

bool session_next_sample(session_t *s, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint_turn_q32) {
    const bool waiting = s->queue_in != s->queue_out;

    if (s->mode == SESSION_LOCKSTEP && !(waiting && s->word_next == SESSION_RECORD_WORDS &&
                                         outbox_telemetry_fits(&s->link[s->run_by].outbox, s->selected))) {
        return false;
    }
    if (waiting) {
        s->held = s->queue[QUEUE_SLOT(s->queue_out)];
        s->queue_out++;
        s->stale = 0;
    } else {
        s->starved++;
        s->stale = (uint16_t)(s->stale + (s->stale != UINT16_MAX ? 1U : 0U));
    }
    memcpy(raw, s->held.raw, sizeof s->held.raw);
    *setpoint_turn_q32 = s->mode == SESSION_LOCKSTEP ? s->held.setpoint_turn_q32 : s->setpoint_turn_q32;
    return true;
}

int32_t session_setpoint(const session_t *s) {
    return s->setpoint_turn_q32;
}

/* ---- words out ---- */

static void send_raw(session_t *s, const control_words_t *w) {
    const message_raw_a_t a = {(int16_t)w->raw[0], (int16_t)w->raw[1], (int16_t)w->raw[2]};
    const message_raw_b_t b = {(int16_t)w->raw[3], (int16_t)w->raw[4], (int16_t)w->raw[5]};
    const uint8_t low = (uint8_t)(s->step & E2E_COUNTER_MASK);
    const uint8_t high = (uint8_t)((s->step >> STEP6_SHIFT) & FLAG_STEP_HIGH);

    if ((s->frames_mask & FRAME_RAW_A) != 0) {
        links_numbered(s, message_raw_a_pack(&a), low, high);
    }
    if ((s->frames_mask & FRAME_RAW_B) != 0) {
        links_numbered(s, message_raw_b_pack(&b), low, high);
    }
}

static void send_named(session_t *s, const control_words_t *w, uint8_t step_low) {
    const uint32_t mask = s->frames_mask;

    if ((mask & FRAME_ANGLE) != 0) {
        const message_angle_t m = {.pulse_0 = (uint16_t)w->pulse_halfus[0], .tilt = w->tilt_turn_q32};
        links_telemetry(s, message_angle_pack(&m), step_low);
    }
    if ((mask & FRAME_BIAS) != 0) {
        const message_bias_t m = {.pulse_1 = (uint16_t)w->pulse_halfus[1], .bias = w->bias_turnps_q28};
        links_telemetry(s, message_bias_pack(&m), step_low);
    }
    if ((mask & FRAME_RATE) != 0) {
        const message_rate_t m = {.rate = w->rate_corrected_turnps_q28};
        links_telemetry(s, message_rate_pack(&m), step_low);
    }
    if ((mask & FRAME_MEASURED) != 0) {
        const message_measured_t m = {.tilt_measured = w->tilt_measured_turn_q32};
        links_telemetry(s, message_measured_pack(&m), step_low);
    }
    if ((mask & FRAME_COMMAND) != 0) {
        const message_command_t m = {.command = w->pid.command_q22};
        links_telemetry(s, message_command_pack(&m), step_low);
    }
}

void run_send_words(session_t *s) {
    const uint8_t step_low = (uint8_t)((s->step - 1U) & E2E_COUNTER_MASK);

    for (; s->word_next < SESSION_RECORD_WORDS; s->word_next++) {
        message_word_t m = {.index = s->word_next};

        if ((s->words_mask[m.index / 32U] >> (m.index % 32U) & 1U) == 0) {
            continue;
        }
        if (s->mode == SESSION_LOCKSTEP && !outbox_telemetry_fits(&s->link[s->run_by].outbox, 1)) {
            return;
        }
        memcpy(&m.value, (const uint8_t *)&s->control->words + 4U * m.index, sizeof m.value);
        links_telemetry(s, message_word_pack(&m), step_low);
    }
}

static void send_step(session_t *s, const message_step_t *m, bool saturated) {
    for (unsigned i = 0; i < LINKS; i++) {
        session_link_t *const l = &s->link[i];
        const uint16_t dropped = l->outbox.dropped; /* before this STEP, which may be dropped itself */

        if (l->open) {
            outbox_telemetry(&l->outbox, message_step_pack(m), step_flags(s, l, saturated));
            l->dropped_told = dropped;
        }
    }
}

void session_stepped(session_t *s) {
    const control_words_t *const w = &s->control->words;
    const message_step_t step = {.step = s->step, .digest = digest_crc32(w, sizeof *w)};
    const bool saturated = (w->flags & FLAGS_SATURATED) != 0;

    s->digest[QUEUE_SLOT(s->step)] = step.digest;
    s->saturated = (uint16_t)(s->saturated + saturated);
    if (s->mode == SESSION_REALTIME && s->setpoint_waiting) {
        const message_setpoint_used_t used = {.step = s->step, .setpoint = s->setpoint_turn_q32};

        s->setpoint_waiting = false;
        links_answer(s, s->setpoint_by, message_setpoint_used_pack(&used), 0);
    }
    send_step(s, &step, saturated);
    send_raw(s, w);
    send_named(s, w, (uint8_t)(s->step & E2E_COUNTER_MASK));
    s->step++;
    s->word_next = 0;
    run_send_words(s);
}
