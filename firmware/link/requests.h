/* Requests: decodes, checks, executes and answers what hosts send.
 *
 * The entry to the session: bytes of the UART and frames of CAN come in here, and each reply goes to the link
 * of its request. docs/reference/protocol.md defines every frame. Time is an argument, in us of the board's
 * clock, modulo 2^32. */
#ifndef PLUMB_LINK_REQUESTS_H
#define PLUMB_LINK_REQUESTS_H

#include "session.h"

/* Number of bytes that requests_receive() may get now, so that every reply has room. 0 while the host does
 * not read its replies. */
size_t requests_room(const session_t *s);

/* Handle received bytes of the UART, at most requests_room(). */
void requests_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* True when requests_receive_frame() may be called: the reply has room. */
bool requests_frame_room(const session_t *s);

/* Handle a received frame of CAN. */
void requests_receive_frame(session_t *s, const can_frame_t *frame, uint32_t now_us);

/* Execute the request of an accepted frame, and answer it. */
void requests_handle(session_t *s, const request_t *request);

#endif
