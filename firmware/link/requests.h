/* Requests: what hosts send, carried out and answered.
 *
 * The upper end of the session: bytes of the UART and frames of CAN come in here, and everything that a frame
 * asks for is looked up, checked and answered to the link it came from. PROTOCOL.md says what every frame
 * is. Time is an argument, in us of the board's clock, modulo 2^32. */
#ifndef PLUMB_LINK_REQUESTS_H
#define PLUMB_LINK_REQUESTS_H

#include "session.h"

/* How many bytes requests_receive() may be given now, so that every reply has room. 0 while the host does not
 * read. */
size_t requests_room(const session_t *s);

/* Received bytes of the UART, at most requests_room(). */
void requests_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us);

/* True when requests_receive_frame() may be called: the reply has room. */
bool requests_frame_room(const session_t *s);

/* A received frame of CAN. */
void requests_receive_frame(session_t *s, const can_frame_t *frame, uint32_t now_us);

/* Carry out what an accepted frame asks for, and answer it. */
void requests_handle(session_t *s, const request_t *request);

#endif
