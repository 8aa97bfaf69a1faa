/* The codec of the UART's lines under any bytes: the parser against a second one that is written from
 * docs/reference/protocol.md ("Commands"), byte by byte and in the pieces of link/commands.c, and frames to
 * text and back.
 *
 * Input: the first byte is the length of the pieces, the others are the bytes of the line. */
#include "input.h"
#include "link/slcan.h"
#include <string.h>

/* ---- a second parser ---- */

typedef struct {
    uint8_t line[SLCAN_LINE_MAX];
    size_t length; /* of the line so far, however long */
    bool spoilt;
    uint32_t bad;
} reference_t;

static int digit_of(uint8_t c) {
    static const char upper[] = "0123456789ABCDEF", lower[] = "0123456789abcdef";
    for (int i = 0; i < 16; i++) {
        if (c == (uint8_t)upper[i] || c == (uint8_t)lower[i]) {
            return i;
        }
    }
    return -1;
}

static bool frame_of(const reference_t *r, can_frame_t *frame) {
    int digits[SLCAN_LINE_MAX];
    *frame = (can_frame_t){0};
    if (r->length < 5) {
        return false;
    }
    for (size_t i = 1; i < r->length; i++) {
        digits[i] = digit_of(r->line[i]);
        if (digits[i] < 0) {
            return false;
        }
    }
    const int id = digits[1] * 256 + digits[2] * 16 + digits[3];
    if (id > 0x7FF || digits[4] > 8 || r->length != (size_t)(5 + 2 * digits[4])) {
        return false;
    }
    frame->id = (uint16_t)id;
    frame->dlc = (uint8_t)digits[4];
    for (int i = 0; i < digits[4]; i++) {
        frame->data[i] = (uint8_t)(digits[5 + 2 * i] * 16 + digits[6 + 2 * i]);
    }
    return true;
}

static slcan_event_t reference_push(reference_t *r, uint8_t byte, can_frame_t *frame) {
    slcan_event_t event = SLCAN_NOTHING;
    if (byte == '\r') {
        if (r->spoilt || r->length > SLCAN_LINE_MAX) {
            event = SLCAN_BAD;
        } else if (r->length == 0) {
            event = SLCAN_EMPTY;
        } else if (r->line[0] != 't') {
            event = SLCAN_COMMAND;
        } else {
            event = frame_of(r, frame) ? SLCAN_FRAME : SLCAN_BAD;
        }
        r->bad += event == SLCAN_BAD;
    } else if (byte == '\a') {
        r->bad += r->spoilt || r->length > 0;
    } else {
        r->spoilt = r->spoilt || byte < 0x20 || byte > 0x7E;
        if (r->length < SLCAN_LINE_MAX) {
            r->line[r->length] = byte;
        }
        r->length++;
        return event;
    }
    r->length = 0;
    r->spoilt = false;
    return event;
}

/* ---- */

static bool same(const can_frame_t *a, const can_frame_t *b) {
    return a->id == b->id && a->dlc == b->dlc && memcmp(a->data, b->data, sizeof a->data) == 0;
}

/* Text of a whole frame is the line that gives it again, in upper-case digits. */
static void check_text(const can_frame_t *frame) {
    uint8_t text[SLCAN_FRAME_CHARS];
    slcan_rx_t rx;
    can_frame_t again = {0};
    const size_t count = slcan_encode(frame, text);
    slcan_rx_init(&rx);
    REQUIRE(count == 6U + 2U * frame->dlc && text[count - 1U] == '\r');
    for (size_t i = 0; i + 1U < count; i++) {
        REQUIRE(i == 0 ? text[i] == 't' : digit_of(text[i]) >= 0 && text[i] <= 'F');
        REQUIRE(slcan_rx_push_byte(&rx, text[i], &again) == SLCAN_NOTHING);
    }
    REQUIRE(slcan_rx_push_byte(&rx, '\r', &again) == SLCAN_FRAME && same(frame, &again));
}

typedef struct {
    slcan_rx_t single, pieces;
    reference_t reference;
} parsers_t;

static void push(parsers_t *p, const uint8_t *bytes, size_t count) {
    for (size_t i = 0; i < count;) {
        const size_t ahead = slcan_rx_push_text(&p->pieces, &bytes[i], count - i);
        can_frame_t frame, other, expected;
        REQUIRE(ahead <= count - i);
        for (size_t end = i + ahead; i < end; i++) {
            REQUIRE(slcan_rx_push_byte(&p->single, bytes[i], &frame) == SLCAN_NOTHING);
            REQUIRE(reference_push(&p->reference, bytes[i], &frame) == SLCAN_NOTHING);
        }
        if (i == count) {
            return;
        }
        const slcan_event_t event = slcan_rx_push_byte(&p->single, bytes[i], &frame);
        REQUIRE(slcan_rx_push_byte(&p->pieces, bytes[i], &other) == event);
        REQUIRE(reference_push(&p->reference, bytes[i], &expected) == event);
        if (event == SLCAN_FRAME) {
            REQUIRE(same(&frame, &expected) && same(&other, &expected));
            check_text(&frame);
        }
        REQUIRE(p->single.bad == p->reference.bad && p->pieces.bad == p->reference.bad);
        i++;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const uint8_t good[] = "\rt1238A0B1C2D3E4F50617\r";
    parsers_t p = {0};
    slcan_rx_init(&p.single);
    slcan_rx_init(&p.pieces);
    const size_t piece = size > 0 ? 1U + data[0] % 64U : 1U;
    for (size_t i = 1; i < size; i += piece) {
        push(&p, &data[i], size - i < piece ? size - i : piece);
    }
    /* Whatever came before, the line after the next CR is received. */
    push(&p, good, sizeof good - 2U);
    can_frame_t frame;
    REQUIRE(slcan_rx_push_byte(&p.single, '\r', &frame) == SLCAN_FRAME && frame.id == 0x123);
    REQUIRE(slcan_rx_push_byte(&p.pieces, '\r', &frame) == SLCAN_FRAME && frame.data[7] == 0x17);
    return 0;
}
