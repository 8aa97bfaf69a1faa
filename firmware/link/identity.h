/* Identity: the items of IDENTITY, by which a board describes itself when a host connects. */
#ifndef PLUMB_LINK_IDENTITY_H
#define PLUMB_LINK_IDENTITY_H

#include "app/board.h"
#include "generated/messages.h"
#include "staging.h"

#define IDENTITY_ITEMS (MESSAGE_IDENTITY_ITEM_UNSAFE_PARAMETER + 1U)

/* Sources of the items. */
typedef struct {
    const board_identity_t *board;
    const params_t *params; /* in use */
    const staging_t *staging;
    uint32_t faults;
    uint32_t now_us;
} identity_t;

/* Value of an item, 0 to IDENTITY_ITEMS - 1. */
uint32_t identity_value(const identity_t *id, uint16_t item);

#endif
