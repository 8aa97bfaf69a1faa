#include "identity.h"

uint32_t identity_value(const identity_t *id, uint16_t item) {
    const board_identity_t *b = id->board;
    const store_report_t *const saved = &id->staging->saved;

    switch (item) {
    case MESSAGE_IDENTITY_ITEM_PROTOCOL_VERSION:
        return MESSAGES_PROTOCOL_VERSION;
    case MESSAGE_IDENTITY_ITEM_DBC_HASH:
        return MESSAGES_DBC_HASH;
    case MESSAGE_IDENTITY_ITEM_GIT_HASH_0:
        return b->git_hash[0];
    case MESSAGE_IDENTITY_ITEM_GIT_HASH_1:
        return b->git_hash[1];
    case MESSAGE_IDENTITY_ITEM_GIT_DIRTY:
        return b->git_dirty;
    case MESSAGE_IDENTITY_ITEM_PART_ID:
        return b->part_id;
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_0:
        return b->unique_id[0];
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_1:
        return b->unique_id[1];
    case MESSAGE_IDENTITY_ITEM_UNIQUE_ID_2:
        return b->unique_id[2];
    case MESSAGE_IDENTITY_ITEM_FLASH_KIB:
        return b->flash_kib;
    case MESSAGE_IDENTITY_ITEM_RAM_KIB:
        return b->ram_kib;
    case MESSAGE_IDENTITY_ITEM_PARAMETER_COUNT:
        return PARAMS_COUNT;
    case MESSAGE_IDENTITY_ITEM_PARAMETER_CRC:
        return params_crc32(id->params);
    case MESSAGE_IDENTITY_ITEM_RECORD_WORDS:
        return (uint32_t)control_words_bytes(&id->params->control) / 4U;
    case MESSAGE_IDENTITY_ITEM_RESET_CAUSE:
        return b->reset_cause;
    case MESSAGE_IDENTITY_ITEM_FAULTS:
        return id->faults;
    case MESSAGE_IDENTITY_ITEM_CRASH_PC:
        return b->crash_pc;
    case MESSAGE_IDENTITY_ITEM_CRASH_EXCEPTION:
        return b->crash_exception;
    case MESSAGE_IDENTITY_ITEM_UPTIME_US:
        return id->now_us;
    case MESSAGE_IDENTITY_ITEM_PINS:
        return b->pins;
    case MESSAGE_IDENTITY_ITEM_PARAMETER_SOURCE:
        return id->staging->source;
    case MESSAGE_IDENTITY_ITEM_SAVED_SEQUENCE:
        return saved->sequence;
    case MESSAGE_IDENTITY_ITEM_SAVED_UNKNOWN:
        return saved->unknown;
    case MESSAGE_IDENTITY_ITEM_SAVED_MISSING:
        return saved->missing;
    case MESSAGE_IDENTITY_ITEM_SYSTEMS:
        return CONTROL_SYSTEMS;
    default:
        return id->staging->unsafe; /* UNSAFE_PARAMETER, the last */
    }
}
