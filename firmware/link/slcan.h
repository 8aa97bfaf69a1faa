/* SLCAN: CAN frames as text ("t10081122334455667788\r"), the format of Lawicel's adapters.
 *
 * The parser resynchronises by itself: CR ends a line, whatever came before it, so that damaged bytes never
 * cost the line after the next CR. It does not interpret commands. */
#ifndef PLUMB_LINK_SLCAN_H
#define PLUMB_LINK_SLCAN_H

#include "e2e.h"
#include <stddef.h>

#define SLCAN_CR          '\r'
#define SLCAN_BEL         '\a'
#define SLCAN_FRAME_CHARS 22U /* 't', 3 digits of id, 1 of length, 16 of data, CR */
#define SLCAN_LINE_MAX                                                                                       \
    26U /* longest command that any SLCAN host sends to a classic CAN adapter, without CR */

typedef enum {
    SLCAN_NOTHING, /* the line goes on */
    SLCAN_EMPTY,   /* CR alone */
    SLCAN_FRAME,   /* a well-formed 't' line: the frame was written */
    SLCAN_COMMAND, /* any other line; its first character is rx->line[0], its length rx->length */
    SLCAN_BAD      /* a malformed 't' line, a byte that is not text, or an overlong line; counted */
} slcan_event_t;

typedef struct {
    uint8_t line[SLCAN_LINE_MAX];
    uint8_t length;   /* characters of the line so far, SLCAN_LINE_MAX + 1 when it is broken */
    uint8_t complete; /* the last event ended a line: the next byte starts a new one */
    uint32_t bad;     /* lines discarded so far */
} slcan_rx_t;

void slcan_rx_init(slcan_rx_t *rx);

/* Append the text at the front of `bytes` to the line that has begun, and return its length; 0 when the next
 * byte begins or ends a line. Takes 10 instructions a character, slcan_rx_push_byte() takes 30. */
size_t slcan_rx_push_text(slcan_rx_t *rx, const uint8_t *bytes, size_t count);

/* Handle one byte. For SLCAN_FRAME the frame is in *frame; otherwise *frame is untouched. */
slcan_event_t slcan_rx_push_byte(slcan_rx_t *rx, uint8_t byte, can_frame_t *frame);

/* Write the text of a frame (upper-case hexadecimal, CR at the end) and return its length, at most
 * SLCAN_FRAME_CHARS. */
size_t slcan_encode(const can_frame_t *frame, uint8_t text[SLCAN_FRAME_CHARS]);

#endif
