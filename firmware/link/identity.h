/* What a board says of itself when a host connects: the items of IDENTITY, 0 to IDENTITY_ITEMS - 1. */
#ifndef PLUMB_LINK_IDENTITY_H
#define PLUMB_LINK_IDENTITY_H

#include "session.h"

#define IDENTITY_ITEMS (MESSAGE_IDENTITY_ITEM_SAVED_MISSING + 1U)

uint32_t identity_value(const session_t *s, uint16_t item, uint32_t now_us);

#endif
