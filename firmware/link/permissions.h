/* Permissions: which frames a link may send before a host has greeted there.
 *
 * Frames that can change the board's behaviour need a greeting with the same protocol version and DBC hash,
 * because another version may give the same bytes another meaning. PARAM_GET, SELECT, DISARM, RUN_END, CLOSE
 * and KEEPALIVE need none. Neither do CHALLENGE and EXECUTE BOOTLOADER, whose frames are the same in every
 * version, so that any host can start the ROM bootloader of any board. */
#ifndef PLUMB_LINK_PERMISSIONS_H
#define PLUMB_LINK_PERMISSIONS_H

#include "e2e.h"

/* True when this frame needs a greeting on its link before it is carried out. */
bool permissions_need_greeting(const can_frame_t *frame);

/* True for the frames of inputs that only some systems have: SAMPLE_C and on, COMMAND_A and on. */
bool permissions_more_inputs(uint16_t id);

#endif
