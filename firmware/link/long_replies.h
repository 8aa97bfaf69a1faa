/* Long replies: IDENTITY after HELLO, and the whole parameter table, sent frame by frame as the outbox has
 * room that telemetry does not need. */
#ifndef PLUMB_LINK_LONG_REPLIES_H
#define PLUMB_LINK_LONG_REPLIES_H

#include "identity.h"

/* The frames of a reply that are left to send: next to end - 1. */
typedef struct {
    uint16_t next;
    uint16_t end;
} long_reply_t;

/* Those of one link. All zero: none. */
typedef struct {
    long_reply_t identity;
    long_reply_t table;
    uint32_t sent_us; /* the last frame of one */
} long_replies_t;

/* From the start, once more. */
void long_replies_ask_identity(long_replies_t *l);
void long_replies_ask_table(long_replies_t *l);

/* Send what has room in the link's outbox. After LONG_REPLIES_STARVED_US without room each frame goes as an
 * ordinary reply: the longest table takes 0.2 s then, less than a host waits for a frame. Call on every turn
 * of the loop. */
#define LONG_REPLIES_STARVED_US 2000U
void long_replies_poll(long_replies_t *l, outbox_t *outbox, const identity_t *id);

#endif
