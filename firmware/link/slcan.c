#include "slcan.h"

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

/* 't', three digits of identifier, one of length, two for each byte; nothing more and nothing less. */
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
    uint8_t *const line = &rx->line[rx->length];
    size_t taken = 0;

    while (taken < count && taken < room && is_text(bytes[taken])) {
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
        /* What an adapter says for no: it ends a line as CR does, and whatever stood before it was none. */
        rx->bad += rx->length != 0;
        rx->length = 0;
    } else { /* one byte that is no text, or one too many, breaks the line up to its CR */
        rx->length = LINE_BROKEN;
    }
    return SLCAN_NOTHING;
}

/* Upper-case digits of the nibbles in the four bytes of a word, the lowest byte first. All four at once: 6
 * more carries 10 to 15, and no other nibble, into bit 4. */
static inline void put_digits(uint8_t *text, uint32_t nibbles) {
    const uint32_t letters = ((nibbles + 0x06060606U) >> 4) & 0x01010101U;
    const uint32_t digits = nibbles + 0x30303030U + letters * ('A' - '0' - 10U);

    text[0] = (uint8_t)digits;
    text[1] = (uint8_t)(digits >> 8);
    text[2] = (uint8_t)(digits >> 16);
    text[3] = (uint8_t)(digits >> 24);
}

size_t slcan_encode(const can_frame_t *frame, uint8_t text[SLCAN_FRAME_CHARS]) {
    const uint32_t id = frame->id;
    size_t n = 5;

    text[0] = 't';
    put_digits(&text[1],
               (id >> 8 & 7U) | (id >> 4 & 15U) << 8 | (id & 15U) << 16 | (frame->dlc & 15UL) << 24);
    for (unsigned i = 0; i < frame->dlc && i < 8U; i += 2U) {
        const uint32_t first = frame->data[i], second = frame->data[i + 1U];

        put_digits(&text[n], first >> 4 | (first & 15U) << 8 | second >> 4 << 16 | (second & 15U) << 24);
        n += 4U;
    }
    n -= frame->dlc < 8U && frame->dlc % 2U != 0 ? 2U : 0U; /* an odd number of bytes */
    text[n++] = SLCAN_CR;
    return n;
}
