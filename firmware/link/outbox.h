/* Outbox: transmit queue of one link, a ring of packed frames. Replies may fill it; telemetry leaves a
 * reserve, and a telemetry frame without room is dropped.
 *
 * On the UART the characters that answer a line are queued between the frames, in order; a frame becomes text
 * only when it goes out. */
#ifndef PLUMB_LINK_OUTBOX_H
#define PLUMB_LINK_OUTBOX_H

#include "slcan.h"

#define OUTBOX_ENTRIES 86U
#define OUTBOX_URGENT  6U  /* part of the reserve, for outbox_urgent() */
#define OUTBOX_RESERVE 30U /* kept free of telemetry, so that replies always fit */
#define OUTBOX_TEXT    8U  /* characters that one entry holds */
#define OUTBOX_ROUND   16U /* kept free of long replies, so that periodic telemetry and steps fit */

/* The low six bits of an identifier are its index in a table of counters. They are unique among the messages
 * of one sender: the generator of messages.h checks it. */
#define OUTBOX_COUNTERS 64U
#define OUTBOX_SLOT(id) ((id) & (OUTBOX_COUNTERS - 1U))

/* A frame of eight bytes, or text: then id is OUTBOX_IS_TEXT | number of characters. */
#define OUTBOX_IS_TEXT 0x8000U
typedef struct {
    uint16_t id;
    uint8_t data[CAN_FRAME_DLC];
} outbox_entry_t;

typedef struct {
    outbox_entry_t ring[OUTBOX_ENTRIES];
    uint8_t first;    /* index of the oldest entry */
    uint8_t count;    /* queued entries */
    uint8_t gone;     /* characters of the oldest entry that were sent already */
    uint16_t dropped; /* telemetry frames dropped, modulo 2^16 */
    uint8_t counter[OUTBOX_COUNTERS];
} outbox_t;

void outbox_init(outbox_t *box);

/* Drop all entries; the counters continue. */
void outbox_clear(outbox_t *box);

/* Free entries. A reply takes one; characters take one, or none when they fit the last entry. */
size_t outbox_room(const outbox_t *box);

/* True when this many frames of telemetry fit now. */
bool outbox_telemetry_fits(const outbox_t *box, size_t frames);

/* True when one more frame of a long reply fits: OUTBOX_ROUND frames of telemetry still fit behind it. */
bool outbox_long_fits(const outbox_t *box);

/* Queue up to OUTBOX_TEXT characters that are not a frame. The caller makes sure that there is room; without
 * it nothing is queued. */
void outbox_put(outbox_t *box, const uint8_t *text, size_t count);

/* Seal a frame and queue it. A telemetry frame without room is counted as dropped, and its counter value is
 * skipped, so that the receiver sees the gap. */
void outbox_reply(outbox_t *box, can_frame_t frame, uint8_t flags);
void outbox_telemetry(outbox_t *box, can_frame_t frame, uint8_t flags);

/* As outbox_reply(), but ahead of all entries that have not begun to go out; urgent frames of one identifier
 * keep their order. Up to OUTBOX_URGENT at once find room when replies leave that part of the reserve free.
 */
void outbox_urgent(outbox_t *box, can_frame_t frame, uint8_t flags);

/* As outbox_telemetry(), with the caller's counter (0..15): for frames numbered by their step. */
void outbox_numbered(outbox_t *box, can_frame_t frame, uint8_t counter, uint8_t flags);

/* Remove up to room characters, in order; returns how many. */
size_t outbox_pop_text(outbox_t *box, uint8_t *out, size_t room);

/* Remove one frame; false when none is queued. For a link that carries only frames. */
bool outbox_pop_frame(outbox_t *box, can_frame_t *frame);

#endif
