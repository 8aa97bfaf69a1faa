/* Permissions: which frames a link may send before a host has greeted there.
 *
 * Everything that can change what the board does needs a greeting with the same protocol version and DBC
 * hash: another version may mean something else by the same bytes. PARAM_GET, SELECT, DISARM, RUN_END, CLOSE
 * and KEEPALIVE need none. Neither do CHALLENGE and EXECUTE BOOTLOADER, whose frames are the same in every
 * version: so any host can bring any board into its ROM bootloader. */
#ifndef PLUMB_LINK_PERMISSIONS_H
#define PLUMB_LINK_PERMISSIONS_H

#include "e2e.h"

/* True when this frame needs a greeting on its link before it is carried out. */
bool permissions_need_greeting(const can_frame_t *frame);

#endif
