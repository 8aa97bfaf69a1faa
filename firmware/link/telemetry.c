#include "telemetry.h"
#include "core/digest.h"
#include "core/fixed.h"
#include "generated/messages.h"
#include <string.h>

/* RAW carries the low six bits of its step number: four as the counter, two as flags. */
#define STEP6_SHIFT    4U
#define FLAG_STEP_HIGH 3U
#define SYSTEM_SHIFT   8U /* a signal's number is the system's number << 8 | the word's place in the record */

/* Bits of SELECT bank 0. */
#define FRAME_RAW_A    0x01U
#define FRAME_RAW_B    0x02U
#define FRAMES_RAW     (FRAME_RAW_A | FRAME_RAW_B)
#define FRAMES_DECLARE 2U  /* the first bit of the frames that the system declares, up to 12 */
#define FRAMES_MORE    14U /* the first bit of RAW_C and the frames after it */
#define INPUTS_AB      6U  /* in RAW_A and RAW_B */
#define FRAME_INPUTS   3U

/* ---- selection ---- */

static uint16_t bits_set(uint32_t mask) {
    uint16_t count = 0;

    for (; mask != 0; mask &= mask - 1U) {
        count++;
    }
    return count;
}

/* Bits of bank 0 whose frames the system has. */
static uint32_t system_frames(const plumb_params_t *params) {
    const control_system_t *const system = control_system(params);
    uint32_t frames = FRAMES_RAW | ((1U << system->frame_count) - 1U) << FRAMES_DECLARE;

#if PLUMB_RAW_MAX > 6
    const unsigned inputs = system->inputs > INPUTS_AB ? system->inputs : INPUTS_AB;
    frames |= ((1U << (inputs - INPUTS_AB) / FRAME_INPUTS) - 1U) << FRAMES_MORE;
#endif
    return frames;
}

/* The bits of a bank of words that lie inside the record. */
static uint32_t words_inside(const plumb_params_t *params, uint32_t first) {
    const uint32_t record = control_system(params)->record_words;

    if (record <= first) {
        return 0;
    }
    return record - first >= 32U ? 0xFFFFFFFFU : (1U << (record - first)) - 1U;
}

void telemetry_select(telemetry_t *t, const plumb_params_t *params, uint16_t bank, uint32_t mask) {
    if (bank == 0) {
        t->frames_mask = mask & system_frames(params);
        t->selected = (uint16_t)(1U + bits_set(t->frames_mask)); /* and STEP */
    } else {
        t->words_mask[bank - 1U] = mask & words_inside(params, 32U * (bank - 1U));
    }
}

void telemetry_select_nothing(telemetry_t *t) {
    t->frames_mask = 0;
    t->selected = 1; /* STEP */
    memset(t->words_mask, 0, sizeof t->words_mask);
}

void telemetry_init(telemetry_t *t, uint32_t *digest) {
    *t = (telemetry_t){.digest = digest};
    telemetry_select_nothing(t);
}

void telemetry_begin(telemetry_t *t) {
    t->word_next = CONTROL_RECORD_WORDS_MAX;
}

/* ---- frames out ---- */

static uint8_t flags_on(const telemetry_t *t, const routing_t *r, unsigned link, uint8_t flags) {
    const bool dropped = t->dropped_sent[link] != r->link[link].outbox->dropped;

    return (uint8_t)(flags | (dropped ? MESSAGE_STEP_DROPPED : 0U));
}

/* Every record begins with the inputs: the raw counts, then the words of commands. */
static void send_raw(const telemetry_t *t, routing_t *r, uint16_t step, const int32_t *raw) {
    const message_raw_a_t a = {(int16_t)raw[0], (int16_t)raw[1], (int16_t)raw[2]};
    const message_raw_b_t b = {(int16_t)raw[3], (int16_t)raw[4], (int16_t)raw[5]};
    const uint8_t low = (uint8_t)(step & E2E_COUNTER_MASK);
    const uint8_t high = (uint8_t)((step >> STEP6_SHIFT) & FLAG_STEP_HIGH);

    if ((t->frames_mask & FRAME_RAW_A) != 0) {
        routing_numbered(r, message_raw_a_pack(&a), low, high);
    }
    if ((t->frames_mask & FRAME_RAW_B) != 0) {
        routing_numbered(r, message_raw_b_pack(&b), low, high);
    }
#if PLUMB_RAW_MAX > 6
    const uint32_t more = t->frames_mask >> FRAMES_MORE;

    for (unsigned i = 0; more >> i != 0; i++) {
        const int32_t *const words = &raw[INPUTS_AB + FRAME_INPUTS * i];
        const message_raw_c_t c = {(int16_t)words[0], (int16_t)words[1], (int16_t)words[2]};
        can_frame_t frame = message_raw_c_pack(&c); /* all have this shape */

        frame.id = (uint16_t)(frame.id + i);
        if ((more >> i & 1U) != 0) {
            routing_numbered(r, frame, low, high);
        }
    }
#endif
}

/* The 16 bits of a frame. */
static uint16_t half_of(const control_frame_t *f, const int32_t *words) {
    if (f->half == CONTROL_NO_WORD) {
        return 0;
    }
    if (f->shift == 0) {
        return (uint16_t)((uint32_t)words[f->half] & 0xFFFFU);
    }
    return (uint16_t)clamp_i32(asr32(words[f->half], f->shift), INT16_MIN, INT16_MAX);
}

/* The frames that the system declares. */
static void send_declared(routing_t *r, uint32_t mask, const control_system_t *system, const int32_t *words,
                          uint8_t step_low) {
    for (unsigned i = 0; i < system->frame_count; i++) {
        if ((mask >> (FRAMES_DECLARE + i) & 1U) != 0) {
            const control_frame_t *const f = &system->frames[i];

            routing_telemetry(r, messages_pair(f->id, half_of(f, words), (uint32_t)words[f->word]), step_low);
        }
    }
}

/* The first selected word at or after a place in the record; CONTROL_RECORD_WORDS_MAX when there is none. A
 * bank of 32 words without a selected one costs one comparison. */
static uint8_t next_selected(const telemetry_t *t, unsigned index) {
    while (index < CONTROL_RECORD_WORDS_MAX) {
        const uint32_t rest = t->words_mask[index / 32U] >> (index % 32U);

        if (rest != 0) {
            return (uint8_t)(index + 31U - clz32(rest & (0U - rest)));
        }
        index = (index / 32U + 1U) * 32U;
    }
    return CONTROL_RECORD_WORDS_MAX;
}

void telemetry_send_words(telemetry_t *t, routing_t *r, const void *record, link_t pacer) {
    const uint8_t *const words = record;

    for (; t->word_next != CONTROL_RECORD_WORDS_MAX; t->word_next++) {
        t->word_next = next_selected(t, t->word_next);
        if (t->word_next == CONTROL_RECORD_WORDS_MAX ||
            (pacer != LINK_NONE && !outbox_long_fits(r->link[pacer].outbox))) {
            return;
        }
        message_word_t m = {.index = (uint16_t)(t->signals | t->word_next)};
        memcpy(&m.value, words + 4U * t->word_next, sizeof m.value);
        routing_telemetry(r, message_word_pack(&m), t->step_low);
    }
}

bool telemetry_has_room(const telemetry_t *t, const routing_t *r, link_t link) {
    return !telemetry_waits(t) && outbox_telemetry_fits(r->link[link].outbox, t->selected);
}

static void send_step(telemetry_t *t, routing_t *r, const message_step_t *m, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        outbox_t *const outbox = r->link[i].outbox;
        const uint16_t dropped = outbox->dropped; /* before this STEP, which may be dropped itself */

        if (r->link[i].open) {
            outbox_telemetry(outbox, message_step_pack(m), flags_on(t, r, i, flags));
            t->dropped_sent[i] = dropped;
        }
    }
}

void telemetry_step(telemetry_t *t, routing_t *r, const control_t *c, const plumb_params_t *params,
                    uint16_t step, uint8_t flags) {
    const int32_t *const words = control_words(c);
    const message_step_t m = {.step = step, .digest = digest_crc32(words, control_words_bytes(params))};

    t->digest[RUN_SLOT(step)] = m.digest;
    t->step_low = (uint8_t)(step & E2E_COUNTER_MASK);
    t->signals = (uint16_t)(params->system << SYSTEM_SHIFT);
    t->word_next = 0;
    send_step(t, r, &m, flags);
    send_raw(t, r, step, words);
    send_declared(r, t->frames_mask, control_system(params), words, t->step_low);
}

void telemetry_repeat_step(const telemetry_t *t, routing_t *r, const request_t *q, uint16_t step,
                           uint8_t flags) {
    const message_step_t m = {.step = step, .digest = t->digest[RUN_SLOT(step)]};

    routing_reply(r, q, message_step_pack(&m), flags_on(t, r, q->link, flags));
}
