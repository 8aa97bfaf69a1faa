#include "long_replies.h"

void long_replies_ask_identity(long_replies_t *l) {
    l->identity = (long_reply_t){0, IDENTITY_ITEMS + 1U};
}

void long_replies_ask_table(long_replies_t *l) {
    l->table = (long_reply_t){0, PARAMS_COUNT};
}

static bool has_room(long_replies_t *l, const outbox_t *outbox, uint32_t now_us) {
    const bool fits = outbox_long_fits(outbox) ||
                      (now_us - l->sent_us >= LONG_REPLIES_STARVED_US && outbox_telemetry_fits(outbox, 1));

    l->sent_us = fits ? now_us : l->sent_us;
    return fits;
}

void long_replies_poll(long_replies_t *l, outbox_t *outbox, const identity_t *id) {
    while (l->identity.next < l->identity.end && has_room(l, outbox, id->now_us)) {
        const uint16_t item = l->identity.next++;
        const bool end = item == IDENTITY_ITEMS;
        const message_identity_t m = {.item = end ? MESSAGE_IDENTITY_ITEM_END : item,
                                      .value = end ? IDENTITY_ITEMS : identity_value(id, item)};

        outbox_reply(outbox, message_identity_pack(&m), 0);
    }
    while (l->table.next < l->table.end && has_room(l, outbox, id->now_us)) {
        const uint16_t index = l->table.next++;
        const message_param_value_t m = {.index = index, .value = params_word(id->params, index)};

        outbox_reply(outbox, message_param_value_pack(&m), 0);
    }
}
