/* Long replies: IDENTITY after HELLO, and the whole parameter table. They go out frame by frame, as the
 * outbox has room beyond what telemetry needs. */
#ifndef PLUMB_LINK_LONG_REPLIES_H
#define PLUMB_LINK_LONG_REPLIES_H

#include "identity.h"

/* The frames of a reply that are not sent yet: next to end - 1. */
typedef struct {
    uint16_t next;
    uint16_t end;
} long_reply_t;

/* The long replies of one link. All zero: none. */
typedef struct {
    long_reply_t identity;
    long_reply_t table;
    uint32_t sent_us; /* when the last frame was queued */
} long_replies_t;

/* Begin the reply, again from its first frame. */
void long_replies_ask_identity(long_replies_t *l);
void long_replies_ask_table(long_replies_t *l);

/* True while frames of a reply are not queued yet. */
static inline bool long_replies_wait(const long_replies_t *l) {
    return l->identity.next < l->identity.end || l->table.next < l->table.end;
}

/* Queue the frames that have room in the link's outbox. After LONG_REPLIES_STARVED_US without room one frame
 * may use the room of telemetry: then the longest table takes 0.2 s, less than a host waits for a frame. Call
 * on every turn of the loop. */
#define LONG_REPLIES_STARVED_US 2000U
void long_replies_poll(long_replies_t *l, outbox_t *outbox, const identity_t *id);

#endif
