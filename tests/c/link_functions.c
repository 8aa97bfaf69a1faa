/* Single functions of the link for Python: tests/support/link_functions.py. */
#include "app/board_guard.h"
#include "generated/params.h"
#include "link/injected.h"
#include "link/receiver.h"
#include "link/slcan.h"
#include <string.h>

/* What the receiver has made of a stream up to a frame. */
typedef struct {
    int32_t end, kind; /* bytes of the stream up to there; crsf_event_t */
    int32_t throttle_q15, words[RECEIVER_WORDS];
    int32_t channels[CRSF_CHANNELS], link_quality;
} receiver_row_t;

/* What the receiver is after a turn of the loop. */
typedef struct {
    int32_t live, on, off, lost,
        number; /* receiver_present(), _rotors_on(), _rotors_off(), and of receiver_t */
    int32_t throttle_q15, words[RECEIVER_WORDS];
} receiver_turn_t;

size_t frames_parse(const uint8_t *bytes, size_t count, uint8_t *frames, uint32_t *bad);
uint8_t frames_crc8(uint16_t id, uint8_t dlc, const uint8_t data[8]);
uint16_t table_unsafe(const uint32_t words[PARAMS_COUNT]);
uint32_t injected_first_doubt(const uint32_t words[PARAMS_COUNT], const int16_t (*counts)[PLUMB_RAW_MAX],
                              uint32_t steps);

size_t receiver_follow(const uint8_t *bytes, size_t count, receiver_row_t *rows);
size_t crsf_after_damage(uint8_t length, uint8_t used, const uint8_t *bytes, size_t count, uint32_t *harmed);
size_t pulses_follow(const uint32_t *edges_us, size_t count, uint32_t turn_us, receiver_row_t *rows);
void receiver_turns(const uint8_t *bytes, const uint64_t *after_us, size_t count, uint32_t begin_us,
                    uint32_t turn_us, uint32_t by_sticks, receiver_turn_t *rows, size_t turns);

/* Memory is not checked here. */
void board_parameters_seal(void) {}

/* params_unsafe() of a whole table. */
uint16_t table_unsafe(const uint32_t words[PARAMS_COUNT]) {
    params_t p;

    memcpy(&p, words, sizeof p);
    return params_unsafe(&p);
}

/* All frames with a right CRC out of a stream, ten bytes each (id big-endian, data); *bad: lines thrown away.
 */
size_t frames_parse(const uint8_t *bytes, size_t count, uint8_t *frames, uint32_t *bad) {
    slcan_rx_t rx;
    size_t found = 0;

    slcan_rx_init(&rx);
    for (size_t i = 0; i < count; i++) {
        can_frame_t frame;

        if (slcan_rx_push_byte(&rx, bytes[i], &frame) == SLCAN_FRAME && e2e_check(&frame)) {
            frames[10 * found] = (uint8_t)(frame.id >> 8);
            frames[10 * found + 1] = (uint8_t)(frame.id & 0xFFU);
            memcpy(&frames[10 * found + 2], frame.data, 8);
            found++;
        }
    }
    *bad = rx.bad;
    return found;
}

uint8_t frames_crc8(uint16_t id, uint8_t dlc, const uint8_t data[8]) {
    can_frame_t frame = {.id = id, .dlc = dlc};

    memcpy(frame.data, data, sizeof frame.data);
    return e2e_crc8(&frame);
}

/* The first step, from 1 on, at which punctual injected samples disarm the board; 0: none does. */
uint32_t injected_first_doubt(const uint32_t words[PARAMS_COUNT], const int16_t (*counts)[PLUMB_RAW_MAX],
                              uint32_t steps) {
    uint8_t marks[INJECTED_NUMBERS];
    injected_t in;
    params_t p;
    uint32_t now_us = 0;

    memcpy(&p, words, sizeof p);
    injected_init(&in, marks);
    injected_begin(&in);
    for (uint32_t step = 0; step < steps; step++, now_us += p.period_us) {
        uint16_t lost;

        if (injected_counts(&in, step % INJECTED_NUMBERS, p.period_us, now_us, &lost)) {
            injected_check(&in, counts[step], control_system(&p.control), &p);
        }
        injected_poll(&in, p.period_us, now_us);
        if (injected_stale(&in) || in.stuck != 0 || in.railed != 0) {
            return step + 1U;
        }
    }
    return 0;
}

/* A row for each frame that is found in a stream. */
size_t receiver_follow(const uint8_t *bytes, size_t count, receiver_row_t *rows) {
    receiver_t r = {0};
    crsf_t c = {0}, same = {0};
    size_t found = 0;

    for (size_t i = 0; i < count; i++) {
        const crsf_event_t kind = crsf_push(&same, bytes[i]);

        receiver_push(&r, &c, &bytes[i], 1, 0U);
        if (kind == CRSF_NOTHING) {
            continue;
        }
        receiver_row_t *const row = &rows[found++];
        *row = (receiver_row_t){.end = (int32_t)i + 1, .kind = (int32_t)kind, .throttle_q15 = r.throttle_q15};
        for (unsigned k = 0; k < RECEIVER_WORDS; k++) {
            row->words[k] = r.words[k];
        }
        for (unsigned k = 0; kind == CRSF_STICKS && k < CRSF_CHANNELS; k++) {
            row->channels[k] = crsf_channel(&same, k);
        }
        row->link_quality = kind == CRSF_STATISTICS ? crsf_link_quality(&same) : 0;
    }
    return found;
}

/* A row for each frame that is found in a pulse train, by a loop that comes round every turn_us; end: the
 * number of edges up to there. */
size_t pulses_follow(const uint32_t *edges_us, size_t count, uint32_t turn_us, receiver_row_t *rows) {
    receiver_t r = {0};
    ppm_t p = {0};
    size_t found = 0, at = 0;
    const uint32_t end_us = (count > 0U ? edges_us[count - 1U] : 0U) + 2U * PPM_PAUSE_US + turn_us;

    for (uint32_t now_us = 0; now_us < end_us; now_us += turn_us) {
        uint16_t stamps_us[32];
        size_t fetched = 0;

        while (at < count && edges_us[at] <= now_us && fetched < sizeof stamps_us / sizeof stamps_us[0]) {
            stamps_us[fetched++] = (uint16_t)edges_us[at++];
        }
        if (!ppm_follow(&p, stamps_us, fetched, now_us)) {
            continue;
        }
        receiver_pulses(&r, p.pulse_us, now_us);
        receiver_row_t *const row = &rows[found++];
        *row = (receiver_row_t){.end = (int32_t)at, .throttle_q15 = r.throttle_q15};
        for (unsigned k = 0; k < RECEIVER_WORDS; k++) {
            row->words[k] = r.words[k];
        }
        for (unsigned k = 0; k < PPM_CHANNELS; k++) {
            row->channels[k] = p.pulse_us[k];
        }
    }
    return found;
}

/* Frames of channels in a stream, by a parser whose counts were damaged before; harmed: bytes behind its
 * memory that it has changed. */
size_t crsf_after_damage(uint8_t length, uint8_t used, const uint8_t *bytes, size_t count, uint32_t *harmed) {
    struct {
        crsf_t parser;
        uint8_t behind[512];
    } memory = {.parser = {.length = length, .used = used}};
    size_t found = 0;

    memset(memory.behind, 0xA5, sizeof memory.behind);
    for (size_t i = 0; i < count; i++) {
        found += crsf_push(&memory.parser, bytes[i]) == CRSF_STICKS;
    }
    *harmed = 0;
    for (size_t i = 0; i < sizeof memory.behind; i++) {
        *harmed += memory.behind[i] != 0xA5U;
    }
    return found;
}

/* A row for each turn of a loop that begins at begin_us by the board's clock and comes round every turn_us.
 * after_us: when each byte has passed, since then. */
void receiver_turns(const uint8_t *bytes, const uint64_t *after_us, size_t count, uint32_t begin_us,
                    uint32_t turn_us, uint32_t by_sticks, receiver_turn_t *rows, size_t turns) {
    receiver_t r = {.by_sticks = by_sticks != 0U};
    crsf_t c = {0};
    size_t from = 0;

    for (size_t turn = 0; turn < turns; turn++) {
        const uint64_t past_us = (uint64_t)turn * turn_us;
        const uint32_t now_us = (uint32_t)(begin_us + past_us);
        size_t to = from;

        while (to < count && after_us[to] <= past_us) {
            to++;
        }
        receiver_push(&r, &c, &bytes[from], to - from, now_us);
        from = to;
        receiver_turn_t *const row = &rows[turn];
        *row = (receiver_turn_t){.live = receiver_present(&r, now_us),
                                 .on = receiver_rotors_on(&r),
                                 .off = receiver_rotors_off(&r),
                                 .lost = r.lost,
                                 .number = r.number,
                                 .throttle_q15 = r.throttle_q15};
        for (unsigned k = 0; k < RECEIVER_WORDS; k++) {
            row->words[k] = r.words[k];
        }
    }
}
