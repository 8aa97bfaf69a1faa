/* Routing: replies go to the requesting link, telemetry to all open links.
 *
 * Owns what is known of each link: whether it is open, who greeted there, what was received and lost. The
 * UART is opened and closed by SLCAN commands, CAN by HELLO, CLOSE and silence. A link that asks is always an
 * argument. Times are in us of the board's clock; differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_ROUTING_H
#define PLUMB_LINK_ROUTING_H

#include "outbox.h"

typedef enum { LINK_UART = 0, LINK_CAN = 1, LINKS = 2, LINK_NONE = LINKS } link_t;

/* One link to a host. */
typedef struct {
    outbox_t *outbox;
    bool open;         /* UART: between O or L and C; CAN: from HELLO to CLOSE or silence */
    bool read_only;    /* opened with L */
    bool greeted;      /* by a host of the same protocol version and message definitions */
    uint8_t *counter;  /* last received per identifier, OUTBOX_COUNTERS of them; 0xFF: none */
    uint16_t rejected; /* received frames that were rejected, modulo 2^16 */
    uint16_t lost;     /* received frames missing by their counter, modulo 2^16 */
    uint32_t heard_us; /* last good frame */
} routing_link_t;

/* A received frame and the link it came from, to which its reply goes. */
typedef struct {
    const can_frame_t *frame;
    link_t link;
    uint32_t now_us;
} request_t;

typedef struct {
    routing_link_t link[LINKS];
    uint32_t can_kbit; /* bit rate for CAN: never another one while a host is there */
} routing_t;

/* Frames that wait and the last counters: they decide no pulse. */
typedef struct {
    outbox_t outbox[LINKS];
    uint8_t counter[LINKS][OUTBOX_COUNTERS];
} routing_buffers_t;

/* Empty outboxes, counters of sent frames at 0. */
void routing_buffers_init(routing_buffers_t *buffers);

/* Both links closed. What waits in the outboxes is still sent. */
void routing_init(routing_t *r, routing_buffers_t *buffers, uint32_t can_kbit);

/* Open or close a link. A link that is closed, or goes from writable to read-only, forgets its greeting. */
void routing_open(routing_t *r, link_t link, bool open, bool read_only);

/* HELLO: received counters start anew. good: the host has the same version and definitions. */
void routing_greet(routing_t *r, link_t link, bool good);

/* True when a received frame is whole and allowed on its link; otherwise it counts as rejected. DISARM is
 * allowed on a closed link, and HELLO opens CAN. */
bool routing_accept(routing_t *r, const request_t *request);

/* Count the frames missing between the last frame of this identifier and this one. */
void routing_note_counter(routing_t *r, const request_t *request);

/* Call on every turn of the loop. Nothing tells CAN that a host went away: after ROUTING_SILENCE_US without a
 * frame CAN is closed and its outbox emptied, so the next host does not get it. True when that happened now.
 * can_kbit: the parameter in use. */
#define ROUTING_SILENCE_US 2000000U
bool routing_poll(routing_t *r, uint32_t can_kbit, uint32_t now_us);

/* Reply to the requesting link. */
void routing_reply(routing_t *r, const request_t *request, can_frame_t frame, uint8_t flags);

/* ACK and NACK of a request, with its counter as their flags. */
void routing_ack(routing_t *r, const request_t *request, uint32_t detail);
void routing_nack(routing_t *r, const request_t *request, uint16_t reason, uint16_t detail);

/* A late reply to a link that asked, and telemetry for the other one. */
void routing_answer(routing_t *r, link_t link, can_frame_t frame, uint8_t flags);

/* Telemetry to every open link; numbered: with a counter (0..15) that the caller gives. A frame without room
 * is dropped and counted in that link's outbox. */
void routing_telemetry(routing_t *r, can_frame_t frame, uint8_t flags);
void routing_numbered(routing_t *r, can_frame_t frame, uint8_t counter, uint8_t flags);

#endif
