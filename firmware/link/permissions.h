/* Permissions: which frames a link may send before a host has greeted there.
 *
 * Everything that can change what the board does needs a greeting with the same protocol version and DBC
 * hash: another version may mean something else by the same bytes. PARAM_GET, SELECT, DISARM, RUN_END, CLOSE
 * and KEEPALIVE need none. Neither do CHALLENGE and EXECUTE BOOTLOADER, whose frames are the same in every
 * version: so any host can bring any board into its ROM bootloader. */
#ifndef PLUMB_LINK_PERMISSIONS_H
#define PLUMB_LINK_PERMISSIONS_H

#include "session.h"

/* True when this frame needs a greeting and nobody has greeted on its link. */
bool permissions_greeting_missing(const session_link_t *l, const can_frame_t *frame);

#endif
