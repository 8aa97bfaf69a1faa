/* Routing: replies go to the requesting link, telemetry to all open links.
 *
 * Owns the state of each link: open or closed, greeted or not, received and lost frames. SLCAN commands open
 * and close the UART; HELLO opens CAN, CLOSE and silence close it. The requesting link is always an argument.
 * Times are in us of the board's clock; differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_ROUTING_H
#define PLUMB_LINK_ROUTING_H

#include "outbox.h"

typedef enum { LINK_UART = 0, LINK_CAN = 1, LINKS = 2, LINK_NONE = LINKS } link_t;

/* One link to a host. */
typedef struct {
    outbox_t *outbox;
    bool open;            /* UART: between O or L and C; CAN: from HELLO to CLOSE or silence */
    bool read_only;       /* opened with L */
    bool greeted;         /* by a host of the same protocol version and message definitions */
    uint8_t *counter;     /* last received per identifier, OUTBOX_COUNTERS of them; 0xFF: none */
    uint16_t rejected;    /* received frames that were rejected, modulo 2^16 */
    uint16_t lost;        /* received frames missing by their counter, modulo 2^16 */
    uint32_t received_us; /* last good frame */
} routing_link_t;

/* A received frame and the link it came from, to which its reply goes. */
typedef struct {
    const can_frame_t *frame;
    link_t link;
    uint32_t now_us;
} request_t;

typedef struct {
    routing_link_t link[LINKS];
    uint32_t can_kbit; /* bit rate for CAN: changes only while no host is connected over CAN */
} routing_t;

/* Frames that wait, and the last counters. */
typedef struct {
    outbox_t outbox[LINKS];
    uint8_t counter[LINKS][OUTBOX_COUNTERS];
} routing_buffers_t;

/* Empty outboxes, counters of sent frames at 0. */
void routing_buffers_init(routing_buffers_t *buffers);

/* Close both links. Frames that wait in the outboxes are still sent. */
void routing_init(routing_t *r, routing_buffers_t *buffers, uint32_t can_kbit);

/* Open or close a link. A link that is closed, or goes from writable to read-only, forgets its greeting. */
void routing_open(routing_t *r, link_t link, bool open, bool read_only);

/* Handle HELLO: the counters of received frames start anew. good: the host has the same protocol version and
 * message definitions. */
void routing_greet(routing_t *r, link_t link, bool good);

/* True when the CRC of a received frame is right and the frame is allowed on its link; otherwise it is
 * counted as rejected. DISARM is allowed on a closed link, and HELLO opens CAN. */
bool routing_accept(routing_t *r, const request_t *request);

/* Count the frames missing between the last frame of this identifier and this one. */
void routing_note_counter(routing_t *r, const request_t *request);

/* Call on every whole turn of the loop. On CAN nothing shows that a host has gone: after ROUTING_SILENCE_US
 * without a frame CAN is closed and its outbox emptied, so that the next host does not get old frames.
 * Returns true when that happened in this call. can_kbit: the parameter in use. */
#define ROUTING_SILENCE_US 2000000U
bool routing_poll(routing_t *r, uint32_t can_kbit, uint32_t now_us);

/* Reply to the requesting link. */
void routing_reply(routing_t *r, const request_t *request, can_frame_t frame, uint8_t flags);

/* ACK and NACK of a request, with its counter as their flags. */
void routing_ack(routing_t *r, const request_t *request, uint32_t detail);
void routing_nack(routing_t *r, const request_t *request, uint16_t reason, uint16_t detail);

/* Reply to `link`, and telemetry to the other link if it is open: for a reply that comes later than its
 * request. */
void routing_answer(routing_t *r, link_t link, can_frame_t frame, uint8_t flags);

/* Telemetry to every open link; routing_numbered(): with the caller's counter (0..15). A frame without room
 * is dropped and counted in that link's outbox. */
void routing_telemetry(routing_t *r, can_frame_t frame, uint8_t flags);
void routing_numbered(routing_t *r, can_frame_t frame, uint8_t counter, uint8_t flags);

#endif
