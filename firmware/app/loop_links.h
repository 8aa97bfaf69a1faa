/* What the main loop moves between the lines of the board and the session. */
#ifndef PLUMB_APP_LOOP_LINKS_H
#define PLUMB_APP_LOOP_LINKS_H

#include "link/session.h"

/* Pass the input of both links to the session, no more than the session has room to answer. */
void loop_links_receive(session_t *s, uint32_t now_us);

/* Send the session's output, as much as the UART and CAN accept. */
void loop_links_transmit(session_buffers_t *buffers);

#endif
