#include "slcan.h"

#define LINE_BROKEN (SLCAN_LINE_MAX + 1U)

void slcan_rx_init(slcan_rx_t *rx) {
    *rx = (slcan_rx_t){0};
}

/* Value of a hexadecimal digit of either case; 16 for anything else. */
static uint8_t digit_value(uint8_t c) {
    if (c >= '0' && c <= '9') {
        return (uint8_t)(c - '0');
    }
    if (c >= 'A' && c <= 'F') {
        return (uint8_t)(c - 'A' + 10);
    }
    if (c >= 'a' && c <= 'f') {
        return (uint8_t)(c - 'a' + 10);
    }
    return 16;
}

/* 't', three digits of identifier, one of length, two for each byte; nothing more and nothing less. */
static bool line_to_frame(const slcan_rx_t *rx, can_frame_t *frame) {
    can_frame_t f = {0};
    uint8_t digit[SLCAN_LINE_MAX];

    for (unsigned i = 1; i < rx->length; i++) {
        digit[i] = digit_value(rx->line[i]);
        if (digit[i] > 15) {
            return false;
        }
    }
    if (rx->length < 5 || digit[1] > (CAN_ID_MAX >> 8) || digit[4] > 8 || rx->length != 5U + 2U * digit[4]) {
        return false;
    }
    f.id = (uint16_t)(((unsigned)digit[1] << 8) | ((unsigned)digit[2] << 4) | digit[3]);
    f.dlc = digit[4];
    for (unsigned i = 0; i < f.dlc; i++) {
        f.data[i] = (uint8_t)(((unsigned)digit[5 + 2 * i] << 4) | digit[6 + 2 * i]);
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

slcan_event_t slcan_rx_take(slcan_rx_t *rx, uint8_t byte, can_frame_t *frame) {
    if (rx->complete) {
        rx->length = 0;
        rx->complete = 0;
    }
    if (byte == SLCAN_CR) {
        rx->complete = 1;
        return line_event(rx, frame);
    }
    if (byte == SLCAN_BEL) {
        /* What an adapter says for no: it ends a line as CR does, and whatever stood before it was none. */
        rx->bad += rx->length != 0;
        rx->length = 0;
        return SLCAN_NOTHING;
    }
    /* One byte that is no text, or one too many, breaks the line up to its CR. */
    if (byte < ' ' || byte > '~' || rx->length >= SLCAN_LINE_MAX) {
        rx->length = LINE_BROKEN;
    } else {
        rx->line[rx->length] = byte;
        rx->length++;
    }
    return SLCAN_NOTHING;
}

size_t slcan_encode(const can_frame_t *frame, uint8_t text[SLCAN_FRAME_CHARS]) {
    static const char hex[] = "0123456789ABCDEF";
    size_t n = 0;

    text[n++] = 't';
    text[n++] = (uint8_t)hex[(frame->id >> 8) & 7U];
    text[n++] = (uint8_t)hex[(frame->id >> 4) & 15U];
    text[n++] = (uint8_t)hex[frame->id & 15U];
    text[n++] = (uint8_t)hex[frame->dlc & 15U];
    for (unsigned i = 0; i < frame->dlc && i < 8U; i++) {
        text[n++] = (uint8_t)hex[frame->data[i] >> 4];
        text[n++] = (uint8_t)hex[frame->data[i] & 15U];
    }
    text[n++] = SLCAN_CR;
    return n;
}
