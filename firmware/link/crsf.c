#include "crsf.h"
#include <stdbool.h>
#include <string.h>

#define SYNC            0xC8U
#define TYPE_STICKS     0x16U
#define TYPE_STATISTICS 0x14U
#define HEADER          3U  /* sync, length, type */
#define AROUND          2U  /* sync and length, which the length does not count */
#define STICKS_LENGTH   24U /* type, 22 bytes, CRC */
#define STATISTICS      12U /* length of that frame: type, 10 bytes, CRC */
#define LEAST_LENGTH    2U  /* type and CRC */
#define MOST_LENGTH     (CRSF_FRAME_BYTES - AROUND)
#define QUALITY_AT      2U
#define CHANNEL_BITS    11U

static uint8_t crc8(const uint8_t *bytes, size_t count) {
    /* Of the upper four bits of the register. */
    static const uint8_t nibble[16] = {0x00, 0xD5, 0x7F, 0xAA, 0xFE, 0x2B, 0x81, 0x54,
                                       0x29, 0xFC, 0x56, 0x83, 0xD7, 0x02, 0xA8, 0x7D};
    unsigned crc = 0;

    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        crc = (crc << 4 & 0xFFU) ^ nibble[crc >> 4];
        crc = (crc << 4 & 0xFFU) ^ nibble[crc >> 4];
    }
    return (uint8_t)crc;
}

/* False for bytes with which no frame begins. */
static bool may_be_frame(const crsf_t *c) {
    const uint8_t *const b = c->bytes;

    return b[0] == SYNC && (c->length < 2U || (b[1] >= LEAST_LENGTH && b[1] <= MOST_LENGTH));
}

/* The kind of a whole frame, by its length and type. */
static crsf_event_t kind_of(const crsf_t *c) {
    const uint8_t length = c->bytes[1], type = c->bytes[2];

    return length == STICKS_LENGTH && type == TYPE_STICKS    ? CRSF_STICKS
           : length == STATISTICS && type == TYPE_STATISTICS ? CRSF_STATISTICS
                                                             : CRSF_NOTHING;
}

static void drop(crsf_t *c, size_t count) {
    if (count == 0U) {
        return; /* nearly every byte of a frame */
    }
    c->length = (uint8_t)(c->length - count);
    memmove(c->bytes, &c->bytes[count], c->length);
}

/* Drops what was found, or everything when memory was damaged: no check word covers it, so it must write
 * nowhere else. */
static void go_on(crsf_t *c) {
    if (c->used > c->length || c->length - c->used >= (int)CRSF_FRAME_BYTES || c->length > CRSF_FRAME_BYTES) {
        c->length = c->used = 0;
    }
    drop(c, c->used);
    c->used = 0;
}

/* Finds the next frame. A whole frame of another kind is dropped as a whole: what its payload looks like is
 * no frame. What is not whole yet is awaited, or after a pause none. */
static crsf_event_t search(crsf_t *c, bool paused) {
    while (c->length > 0U) {
        const uint8_t whole = (uint8_t)(c->bytes[1] + AROUND);
        const bool begun = c->length < HEADER || c->length < whole;

        if (!may_be_frame(c) || (begun && paused)) {
            drop(c, 1U);
            continue;
        }
        if (begun) {
            return CRSF_NOTHING;
        }
        const bool agrees = crc8(&c->bytes[AROUND], whole - HEADER) == c->bytes[whole - 1U];
        const crsf_event_t kind = agrees ? kind_of(c) : CRSF_NOTHING;

        if (kind != CRSF_NOTHING) {
            c->used = whole;
            return kind;
        }
        drop(c, agrees ? whole : 1U);
    }
    return CRSF_NOTHING;
}

/* True when the next byte lies inside a frame that has begun, and does not end it: nearly always. */
static bool inside(const crsf_t *c) {
    return c->used == 0U && c->length >= AROUND && c->bytes[0] == SYNC && c->bytes[1] <= MOST_LENGTH &&
           c->length + 1U < c->bytes[1] + AROUND;
}

crsf_event_t crsf_push(crsf_t *c, uint8_t byte) {
    if (inside(c)) {
        c->bytes[c->length++] = byte;
        return CRSF_NOTHING;
    }
    go_on(c);
    c->bytes[c->length++] = byte;
    return search(c, false);
}

crsf_event_t crsf_pause(crsf_t *c) {
    go_on(c);
    return search(c, true);
}

uint16_t crsf_channel(const crsf_t *c, unsigned channel) {
    const unsigned bit = CHANNEL_BITS * channel;
    const uint8_t *const at = &c->bytes[HEADER + bit / 8U];
    uint32_t bits = at[0] | (uint32_t)at[1] << 8;

    if (bit % 8U + CHANNEL_BITS > 16U) {
        bits |= (uint32_t)at[2] << 16;
    }
    return (uint16_t)(bits >> bit % 8U & ((1U << CHANNEL_BITS) - 1U));
}

uint8_t crsf_link_quality(const crsf_t *c) {
    return c->bytes[HEADER + QUALITY_AT];
}
