/* Permissions: which frames a link may send before a host has greeted there.
 *
 * Everything that can change what the board does needs a greeting with the same protocol version and DBC
 * hash: another version may mean something else by the same bytes. Reading, SELECT, DISARM, RUN_END, CLOSE
 * and KEEPALIVE need none, nor does the way into the ROM bootloader (CHALLENGE, EXECUTE BOOTLOADER), whose
 * frames are the same in every version. */
#ifndef PLUMB_LINK_PERMISSIONS_H
#define PLUMB_LINK_PERMISSIONS_H

#include "session.h"

/* True when this frame needs a greeting that its link has not had. */
bool permissions_greeting_missing(const session_link_t *l, const can_frame_t *frame);

#endif
