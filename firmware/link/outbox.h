/* What waits for the UART: a ring of text. Replies may fill it, telemetry leaves a reserve and is dropped
 * whole. */
#ifndef PLUMB_LINK_OUTBOX_H
#define PLUMB_LINK_OUTBOX_H

#include "slcan.h"

#define OUTBOX_BYTES   2048U /* power of two */
#define OUTBOX_RESERVE 512U  /* kept free of telemetry, so that replies always fit */

/* The low six bits of an identifier are its place in a table of counters: they differ between all messages of
 * one sender (the generator of messages.h refuses others). */
#define OUTBOX_COUNTERS 64U
#define OUTBOX_SLOT(id) ((id) & (OUTBOX_COUNTERS - 1U))

typedef struct {
    uint8_t text[OUTBOX_BYTES];
    uint16_t head;    /* bytes ever put in, modulo 2^16 */
    uint16_t tail;    /* bytes ever taken out, modulo 2^16 */
    uint16_t dropped; /* telemetry frames thrown away, modulo 2^16 */
    uint8_t counter[OUTBOX_COUNTERS];
} outbox_t;

void outbox_init(outbox_t *box);

/* Bytes that fit. */
size_t outbox_room(const outbox_t *box);

/* True when this many frames of telemetry fit now. */
bool outbox_telemetry_fits(const outbox_t *box, size_t frames);

/* Text that is no frame, or nothing when it does not fit (the caller has made sure that it does). */
void outbox_put(outbox_t *box, const uint8_t *text, size_t count);

/* Seal and queue. A telemetry frame without room is counted as dropped, and its number in byte 1 is skipped,
 * so that the receiver sees the gap. */
void outbox_reply(outbox_t *box, can_frame_t frame, uint8_t flags);
void outbox_telemetry(outbox_t *box, can_frame_t frame, uint8_t flags);

/* As telemetry, with a counter (0..15) that the caller knows: frames that are numbered by their step. */
void outbox_numbered(outbox_t *box, can_frame_t frame, uint8_t counter, uint8_t flags);

/* Take up to room bytes, in order; returns how many. */
size_t outbox_take(outbox_t *box, uint8_t *out, size_t room);

#endif
