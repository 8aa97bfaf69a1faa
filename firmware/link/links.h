/* The ways to a host, and who hears what: a reply goes where its question came from, telemetry to every link
 * that is open. For the files of the session; they find the link of the request at hand in session.asked. */
#ifndef PLUMB_LINK_LINKS_H
#define PLUMB_LINK_LINKS_H

#include "session.h"

void links_init(session_t *s);

/* Open or close a link. What was armed over one that is closed, or opened for reading alone, is disarmed at
 * once. */
void links_open(session_t *s, link_t link, bool open, bool read_only);

/* A frame of a link: true when it is whole and may be taken, else it was counted as rejected. */
bool links_accept(session_t *s, link_t link, const can_frame_t *frame, uint32_t now_us);

/* Count what is missing between the last frame of an identifier and this one. A greeting begins anew. */
void links_forget_counters(session_link_t *l);
void links_note_counter(session_link_t *l, const can_frame_t *frame);

/* CAN has nobody who says that a host went away: a link over which nothing came for LINKS_SILENCE_US is
 * closed. While it is closed its bit rate may change. */
void links_poll(session_t *s, uint32_t now_us);

/* To who asked. */
void links_reply(session_t *s, can_frame_t frame, uint8_t flags);

/* To who asked at another time, and to the other link as telemetry. */
void links_answer(session_t *s, link_t asked, can_frame_t frame, uint8_t flags);

/* To every open link; numbered: with a counter that the caller knows. Without room it is dropped, and counted
 * there. */
void links_telemetry(session_t *s, can_frame_t frame, uint8_t flags);
void links_numbered(session_t *s, can_frame_t frame, uint8_t counter, uint8_t flags);

#endif
