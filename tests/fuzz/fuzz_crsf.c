/* The receiver under any bytes: the parser of CRSF against a second one that is written from
 * docs/reference/receiver.md and looks at the whole stream at once, and the limits of the inputs it makes.
 *
 * Input: the first byte says whether what looks like a frame gets its CRC, the others are the bytes of the
 * line. */
#include "input.h"
#include "link/receiver.h"
#include <string.h>

#define SYNC         0xC8U
#define STICKS_BYTES 26U
#define NUMBERS      255

/* ---- a second parser ---- */

static uint8_t reference_crc(const uint8_t *bytes, size_t count) {
    unsigned crc = 0;
    for (size_t bit = 0; bit < 8U * count; bit++) {
        const unsigned in = (unsigned)bytes[bit / 8U] >> (7U - bit % 8U) & 1U;
        const unsigned out = crc >> 7 & 1U;
        crc = (crc << 1 & 0xFFU) ^ (in != out ? 0xD5U : 0U);
    }
    return (uint8_t)crc;
}

/* Bytes of the frame at this place: 0 where none can be, more than there are where it is not whole yet. */
static size_t frame_at(const uint8_t *bytes, size_t left) {
    if (bytes[0] != SYNC) {
        return 0U;
    }
    if (left < 2U) {
        return 2U;
    }
    const size_t size = bytes[1] + 2U;
    if (size < 4U || size > CRSF_FRAME_BYTES) {
        return 0U;
    }
    const bool whole = left >= size;
    return whole && reference_crc(&bytes[2], size - 3U) != bytes[size - 1U] ? 0U : size;
}

typedef struct {
    size_t frames, sticks;
    uint8_t last[STICKS_BYTES]; /* of the frames of channels */
} reference_t;

static reference_t reference_of(const uint8_t *bytes, size_t count) {
    reference_t r = {0};
    size_t at = 0;
    while (at < count) {
        const size_t size = frame_at(&bytes[at], count - at);
        if (size > count - at) {
            break;
        }
        if (size == 0U) {
            at++;
            continue;
        }
        const bool sticks = size == STICKS_BYTES && bytes[at + 2U] == 0x16U;
        r.frames += sticks || (size == 14U && bytes[at + 2U] == 0x14U);
        if (sticks) {
            r.sticks++;
            memcpy(r.last, &bytes[at], size);
        }
        at += size;
    }
    return r;
}

/* Bit by bit. */
static uint16_t reference_channel(const uint8_t *frame, unsigned channel) {
    unsigned value = 0;
    for (unsigned bit = 0; bit < 11U; bit++) {
        const unsigned at = 11U * channel + bit;
        value |= (unsigned)(frame[3U + at / 8U] >> at % 8U & 1U) << bit;
    }
    return (uint16_t)value;
}

/* ---- */

/* Gives everything that has the length of a frame the right CRC, from the first byte on. */
static void seal(uint8_t *bytes, size_t count) {
    size_t at = 0;
    while (at < count) {
        const size_t size = bytes[at] == SYNC && count - at > 2U ? bytes[at + 1U] + 2U : 0U;
        if (size >= 4U && size <= CRSF_FRAME_BYTES && size <= count - at) {
            bytes[at + size - 1U] = reference_crc(&bytes[at + 2U], size - 3U);
            at += size;
        } else {
            at++;
        }
    }
}

static void check_limits(const receiver_t *r) {
    REQUIRE(r->throttle_q15 >= 0);
    for (unsigned i = 0; i < 3U; i++) {
        REQUIRE(r->words[i] >= -INT16_MAX);
    }
    REQUIRE(r->words[3] >= 0 && r->words[3] <= (RECEIVER_ROTORS_ON | RECEIVER_MODE_RATE));
    REQUIRE(r->words[4] == r->number);
}

int LLVMFuzzerTestOneInput(const uint8_t *input, size_t length) {
    static uint8_t data[INPUT_MAX];
    const size_t size = length < 1U ? 0U : (length < INPUT_MAX ? length : INPUT_MAX) - 1U;
    static const uint8_t quiet[CRSF_FRAME_BYTES] = {0};
    static const uint8_t statistics[] = {SYNC, 12U, 0x14U, 40, 40, 100, 10, 0, 2, 3, 45, 100, 8};
    receiver_t r = {0};
    crsf_t c = {0}, alone = {0};
    crsf_event_t kind;
    size_t frames = 0, sticks = 0, counted = 0;
    uint16_t last[CRSF_CHANNELS] = {0};

    memcpy(data, size > 0U ? &input[1] : input, size);
    if (size > 0U && (input[0] & 1U) != 0U) {
        seal(data, size);
    }
    for (size_t i = 0; i < size; i++) {
        const receiver_t before = r;
        receiver_push(&r, &c, &data[i], 1U, 0U);
        check_limits(&r);
        kind = crsf_push(&alone, data[i]);
        frames += kind != CRSF_NOTHING;
        sticks += kind == CRSF_STICKS;
        if (kind != CRSF_STICKS || before.lost) { /* nothing moves */
            REQUIRE(r.throttle_q15 == before.throttle_q15 && memcmp(r.words, before.words, 8U) == 0);
        }
        counted += kind == CRSF_STICKS && !before.lost;
        REQUIRE(r.number == (counted == 0U ? 0U : (counted - 1U) % NUMBERS + 1U));
        for (unsigned k = 0; kind == CRSF_STICKS && k < CRSF_CHANNELS; k++) {
            last[k] = crsf_channel(&alone, k);
        }
    }
    const reference_t expected = reference_of(data, size);
    REQUIRE(frames == expected.frames && sticks == expected.sticks);
    for (unsigned k = 0; k < CRSF_CHANNELS && sticks > 0U; k++) {
        REQUIRE(last[k] == reference_channel(expected.last, k));
    }
    /* After so many bytes that begin no frame, the next frame is received. */
    uint8_t crc = reference_crc(&statistics[2], sizeof statistics - 2U);
    receiver_push(&r, &c, quiet, sizeof quiet, 0U);
    receiver_push(&r, &c, statistics, sizeof statistics, 0U);
    receiver_push(&r, &c, &crc, 1U, 0U);
    REQUIRE(!r.lost);
    return 0;
}
