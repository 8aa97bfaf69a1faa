#include "staging.h"
#include "app/board.h"
#include "app/board_guard.h"
#include "generated/messages.h"
#include "generated/used_parts.h"

uint16_t staging_unsafe(const params_t *p) {
    return USED_ACTUATORS ? params_unsafe(p) : PARAMS_COUNT;
}

void staging_init(staging_t *s, params_t *table, const params_t *in_use) {
    *s = (staging_t){.table = table, .unsafe = staging_unsafe(in_use), .gains = params_live(in_use)};
    *table = *in_use;
}

void staging_loaded(staging_t *s, const store_report_t *report) {
    s->saved = *report;
    s->source = (uint16_t)report->found;
}

void staging_discard(staging_t *s, link_t link, const params_t *in_use) {
    if (s->by == link) {
        *s->table = *in_use;
        s->pending = false;
    }
}

void staging_on_get(routing_t *routing, const request_t *q, const params_t *in_use) {
    const message_param_get_t m = message_param_get_unpack(q->frame);

    if (m.index < PARAMS_COUNT) {
        const message_param_value_t value = {.index = m.index, .value = params_word(in_use, m.index)};

        routing_reply(routing, q, message_param_value_pack(&value), 0);
    } else {
        routing_nack(routing, q, MESSAGE_NACK_REASON_INDEX, m.index);
    }
}

void staging_on_set(staging_t *s, routing_t *routing, const request_t *q, const params_t *in_use) {
    const message_param_set_t m = message_param_set_unpack(q->frame);

    if (m.index >= PARAMS_COUNT) {
        routing_nack(routing, q, MESSAGE_NACK_REASON_INDEX, m.index);
    } else if (!params_in_range(m.index, m.value)) {
        routing_nack(routing, q, MESSAGE_NACK_REASON_RANGE, m.index);
    } else {
        const message_param_staged_t staged = {.index = m.index, .value = m.value};

        if (!s->pending || s->by != q->link) { /* discard what another host has staged */
            *s->table = *in_use;
            s->by = q->link;
        }
        params_set_word(s->table, m.index, m.value);
        s->pending = true;
        routing_reply(routing, q, message_param_staged_pack(&staged), 0);
    }
}

uint16_t staging_check_commit(const staging_t *s, const can_frame_t *frame, uint16_t *detail) {
    const message_param_commit_t m = message_param_commit_unpack(frame);

    if (m.count != PARAMS_COUNT) {
        *detail = PARAMS_COUNT;
        return MESSAGE_NACK_REASON_COUNT;
    }
    *detail = 0;
    if (m.crc != params_crc32(s->table)) {
        return MESSAGE_NACK_REASON_CRC;
    }
    return store_accepts(s->table) ? 0 : MESSAGE_NACK_REASON_PARAMETERS;
}

#if CONTROL_LEARNS
void staging_learn(params_t *in_use, uint16_t index, uint32_t value) {
    const uint32_t before = params_word(in_use, index);

    if (params_in_range(index, value)) {
        params_set_word(in_use, index, value);
        if (!store_accepts(in_use)) {
            params_set_word(in_use, index, before);
        }
        board_parameters_seal();
    }
}
#endif

uint16_t staging_save(staging_t *s, const params_t *in_use) {
    if (!store_save(in_use, &s->saved.sequence)) {
        return MESSAGE_NACK_REASON_FLASH;
    }
    s->source = STORE_LOADED;
    s->saved.unknown = 0;
    s->saved.missing = 0;
    return 0;
}

uint16_t staging_load(staging_t *s, const params_t *in_use) {
    const store_report_t report = store_load(s->table);

    if (report.found != STORE_LOADED) {
        *s->table = *in_use;
        return report.found == STORE_NOTHING ? MESSAGE_NACK_REASON_NOTHING_SAVED
                                             : MESSAGE_NACK_REASON_PARAMETERS;
    }
    staging_loaded(s, &report);
    return 0;
}

void staging_defaults(staging_t *s) {
    params_default(s->table);
    s->source = STORE_NOTHING;
}

void staging_apply(staging_t *s, params_t *in_use, bool armed) {
    *in_use = *s->table;
    board_parameters_seal();
    s->unsafe = staging_unsafe(in_use);
    if (!armed) {
        s->gains = params_live(in_use);
    }
    s->pending = false;
}

void staging_committed(staging_t *s) {
    s->source = STAGING_FROM_HOST;
}

uint32_t staging_faults(const staging_t *s) {
    return s->source == STORE_DAMAGED || s->source == STORE_REFUSED ? BOARD_FAULT_PARAMETERS : 0U;
}
