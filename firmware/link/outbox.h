/* What waits for one link: a ring of frames, packed. Replies may fill it, telemetry leaves a reserve and is
 * dropped whole.
 *
 * On the UART the characters that answer a line stand between the frames and keep their place; a frame
 * becomes text only when it goes out. */
#ifndef PLUMB_LINK_OUTBOX_H
#define PLUMB_LINK_OUTBOX_H

#include "slcan.h"

#define OUTBOX_ENTRIES 86U
#define OUTBOX_URGENT  6U  /* of the reserve, for frames that go first */
#define OUTBOX_RESERVE 30U /* kept free of telemetry, so that replies always fit */
#define OUTBOX_TEXT    8U  /* characters that one entry holds */
#define OUTBOX_ROUND   16U /* kept free of long replies, so that periodic telemetry and steps fit */

/* The low six bits of an identifier are its place in a table of counters: they differ between all messages of
 * one sender (the generator of messages.h refuses others). */
#define OUTBOX_COUNTERS 64U
#define OUTBOX_SLOT(id) ((id) & (OUTBOX_COUNTERS - 1U))

/* A frame of eight bytes, or text: then id is OUTBOX_IS_TEXT and the number of characters. */
#define OUTBOX_IS_TEXT 0x8000U
typedef struct {
    uint16_t id;
    uint8_t data[CAN_FRAME_DLC];
} outbox_entry_t;

typedef struct {
    outbox_entry_t ring[OUTBOX_ENTRIES];
    uint8_t first;    /* place of the oldest entry */
    uint8_t count;    /* entries that wait */
    uint8_t gone;     /* characters of the oldest that went out */
    uint16_t dropped; /* telemetry frames thrown away, modulo 2^16 */
    uint8_t counter[OUTBOX_COUNTERS];
} outbox_t;

void outbox_init(outbox_t *box);

/* Forget what waits; the counters go on. */
void outbox_clear(outbox_t *box);

/* Entries that are free. A reply takes one, characters none or one. */
size_t outbox_room(const outbox_t *box);

/* True when this many frames of telemetry fit now. */
bool outbox_telemetry_fits(const outbox_t *box, size_t frames);

/* True when one more frame of a long reply fits: OUTBOX_ROUND frames of telemetry still fit behind it. */
bool outbox_long_fits(const outbox_t *box);

/* Up to OUTBOX_TEXT characters that are no frame, or nothing when they do not fit (the caller has made sure
 * that they do). */
void outbox_put(outbox_t *box, const uint8_t *text, size_t count);

/* Seal and queue. A telemetry frame without room is counted as dropped, and its number in byte 1 is skipped,
 * so that the receiver sees the gap. */
void outbox_reply(outbox_t *box, can_frame_t frame, uint8_t flags);
void outbox_telemetry(outbox_t *box, can_frame_t frame, uint8_t flags);

/* As a reply, but before all that waits and has not begun to go out; in order among its like. Of no more than
 * OUTBOX_URGENT at once none is lost, as long as others leave them room. */
void outbox_urgent(outbox_t *box, can_frame_t frame, uint8_t flags);

/* As telemetry, with a counter (0..15) that the caller knows: frames that are numbered by their step. */
void outbox_numbered(outbox_t *box, can_frame_t frame, uint8_t counter, uint8_t flags);

/* Remove up to room characters, in order; returns how many. */
size_t outbox_pop_text(outbox_t *box, uint8_t *out, size_t room);

/* Remove one frame; false when none waits. For a link that carries frames alone. */
bool outbox_pop_frame(outbox_t *box, can_frame_t *frame);

#endif
