/* What the board sends unasked: its state, values of the keep-alive, the time; and long replies. */
#ifndef PLUMB_LINK_NEWS_H
#define PLUMB_LINK_NEWS_H

#include "session_state.h"

/* Send PLAUSIBILITY to one link. */
void session_send_readiness(session_t *s, link_t link);

/* Send STATUS and the frames that follow it to every open link: those that changed, or all when the period is
 * over. */
void session_send_news(session_t *s, uint32_t now_us);

/* Send the next keep-alive value, when one is due, to the host that armed, ahead of all frames queued for its
 * link. */
void session_issue_keepalive(session_t *s, uint32_t now_us);

void session_send_long_replies(session_t *s, uint32_t now_us);
void session_send_time(session_t *s, uint32_t now_us);

#endif
