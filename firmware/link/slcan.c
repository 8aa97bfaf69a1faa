#include "slcan.h"
#include <string.h>

#define LINE_BROKEN (SLCAN_LINE_MAX + 1U)

void slcan_rx_init(slcan_rx_t *rx) {
    *rx = (slcan_rx_t){0};
}

/* Value of a hexadecimal digit of either case; above 15 for anything else. */
static inline unsigned digit_value(uint8_t c) {
    const unsigned decimal = (unsigned)c - '0';
    const unsigned letter = ((unsigned)c | 0x20U) - 'a';

    if (decimal <= 9U) {
        return decimal;
    }
    return letter <= 5U ? letter + 10U : 16U;
}

/* Parses exactly 't', three digits of identifier, one of length and two for each byte. */
static bool line_to_frame(const slcan_rx_t *rx, can_frame_t *frame) {
    const uint8_t *at = &rx->line[5];
    const unsigned high = digit_value(rx->line[1]), middle = digit_value(rx->line[2]);
    const unsigned low = digit_value(rx->line[3]), dlc = digit_value(rx->line[4]);
    unsigned seen = middle | low; /* of all digits */
    can_frame_t f = {0};

    if (rx->length < 5 || high > (CAN_ID_MAX >> 8) || dlc > 8 || rx->length != 5U + 2U * dlc) {
        return false;
    }
    f.id = (uint16_t)(high << 8 | middle << 4 | low);
    f.dlc = (uint8_t)dlc;
    for (unsigned i = 0; i < dlc; i++) {
        const unsigned upper = digit_value(*at++), lower = digit_value(*at++);
        seen |= upper | lower;
        f.data[i] = (uint8_t)(upper << 4 | lower);
    }
    if (seen > 15U) {
        return false;
    }
    *frame = f;
    return true;
}

static slcan_event_t line_event(slcan_rx_t *rx, can_frame_t *frame) {
    if (rx->length == 0) {
        return SLCAN_EMPTY;
    }
    if (rx->length <= SLCAN_LINE_MAX) {
        if (rx->line[0] != 't') {
            return SLCAN_COMMAND;
        }
        if (line_to_frame(rx, frame)) {
            return SLCAN_FRAME;
        }
    }
    rx->bad++;
    return SLCAN_BAD;
}

static bool is_text(uint8_t byte) {
    return byte >= ' ' && byte <= '~';
}

size_t slcan_rx_push_text(slcan_rx_t *rx, const uint8_t *bytes, size_t count) {
    if (rx->complete || rx->length >= SLCAN_LINE_MAX) {
        return 0;
    }
    const size_t room = SLCAN_LINE_MAX - (size_t)rx->length;
    const size_t most = count < room ? count : room;
    uint8_t *const line = &rx->line[rx->length];
    size_t taken = 0;

    while (taken < most && is_text(bytes[taken])) {
        line[taken] = bytes[taken];
        taken++;
    }
    rx->length = (uint8_t)(rx->length + taken);
    return taken;
}

slcan_event_t slcan_rx_push_byte(slcan_rx_t *rx, uint8_t byte, can_frame_t *frame) {
    if (rx->complete) {
        rx->length = 0;
        rx->complete = 0;
    }
    if (is_text(byte) && rx->length < SLCAN_LINE_MAX) {
        rx->line[rx->length] = byte;
        rx->length++;
    } else if (byte == SLCAN_CR) {
        rx->complete = 1;
        return line_event(rx, frame);
    } else if (byte == SLCAN_BEL) {
        /* BEL, the refusal of an adapter: it ends a line as CR does, and the characters before it are bad. */
        rx->bad += rx->length != 0;
        rx->length = 0;
    } else { /* a byte that is not text, or one too many, spoils the line up to its CR */
        rx->length = LINE_BROKEN;
    }
    return SLCAN_NOTHING;
}

/* Writes the upper-case hexadecimal digits of four nibbles, one in each byte of a word, lowest byte first.
 * All four at once: adding 6 carries 10 to 15, and no other nibble, into bit 4. */
static inline void put_digits(uint8_t *text, uint32_t nibbles) {
    const uint32_t letters = ((nibbles + 0x06060606U) >> 4) & 0x01010101U;
    const uint32_t digits = nibbles + 0x30303030U + letters * ('A' - '0' - 10U);

    memcpy(text, &digits, sizeof digits); /* little-endian, as everywhere */
}

/* The four nibbles of two bytes, the high one of `first` lowest, one to a byte. */
static inline uint32_t nibbles_of(uint32_t first, uint32_t second) {
    const uint32_t apart = first | second << 16;

    return (apart >> 4 & 0x000F000FU) | (apart & 0x000F000FU) << 8;
}

size_t slcan_encode(const can_frame_t *frame, uint8_t text[SLCAN_FRAME_CHARS]) {
    const uint8_t *const data = frame->data;
    const size_t bytes = frame->dlc < CAN_FRAME_DLC ? frame->dlc : CAN_FRAME_DLC;

    text[0] = 't';
    put_digits(&text[1], nibbles_of(frame->id >> 4 & 0x7FU, (frame->id & 15U) << 4 | (frame->dlc & 15U)));
    put_digits(&text[5], nibbles_of(data[0], data[1]));
    put_digits(&text[9], nibbles_of(data[2], data[3]));
    put_digits(&text[13], nibbles_of(data[4], data[5]));
    put_digits(&text[17], nibbles_of(data[6], data[7]));
    text[5U + 2U * bytes] = SLCAN_CR;
    return 6U + 2U * bytes;
}
