#include "requests.h"
#include "messages.h"
#include "run.h"

/* The ACK leaves within 3 ms of UART time behind at most 93 ms of queue; the host hears it before silence
 * falls. */
#define BOOTLOADER_AFTER_US 100000U

void requests_loaded(session_t *s, const store_report_t *report) {
    s->saved = *report;
    s->parameters_from = (uint16_t)report->found;
}

void requests_committed(session_t *s) {
    s->parameters_from = REQUESTS_FROM_HOST;
}

uint32_t requests_faults(const session_t *s) {
    return s->parameters_from == STORE_DAMAGED || s->parameters_from == STORE_REFUSED ? BOARD_FAULT_PARAMETERS
                                                                                      : 0U;
}

bool requests_bootloader_due(const session_t *s, uint32_t now_us) {
    return s->bootloader_asked && now_us - s->bootloader_us >= BOOTLOADER_AFTER_US;
}

void requests_withdraw_bootloader(session_t *s) {
    s->bootloader_asked = false;
}

static uint16_t save(session_t *s) {
    if (!store_save(s->params, &s->saved.sequence)) {
        return MESSAGE_NACK_REASON_FLASH;
    }
    s->parameters_from = STORE_LOADED;
    s->saved.unknown = 0;
    s->saved.missing = 0;
    return 0;
}

static uint16_t load(session_t *s) {
    const store_report_t report = store_load(&s->buffers->staged);

    if (report.found != STORE_LOADED) {
        s->buffers->staged = *s->params;
        return report.found == STORE_NOTHING ? MESSAGE_NACK_REASON_NOTHING_SAVED
                                             : MESSAGE_NACK_REASON_PARAMETERS;
    }
    requests_loaded(s, &report);
    return 0;
}

uint16_t requests_execute(session_t *s, uint16_t verb, uint32_t now_us) {
    uint16_t reason = 0;

    if (s->mode != SESSION_IDLE || arming_armed(&s->arming)) {
        return MESSAGE_NACK_REASON_BUSY;
    }
    switch (verb) {
    case MESSAGE_EXECUTE_VERB_SAVE:
        return save(s);
    case MESSAGE_EXECUTE_VERB_LOAD:
        reason = load(s);
        break;
    case MESSAGE_EXECUTE_VERB_DEFAULTS:
        params_default(&s->buffers->staged);
        s->parameters_from = STORE_NOTHING;
        break;
    case MESSAGE_EXECUTE_VERB_BOOTLOADER:
        /* The ROM of this part listens on PA9 and PA10, and nowhere else. */
        if (s->asked != LINK_UART || s->board->pins != BOARD_PINS_STANDARD) {
            return MESSAGE_NACK_REASON_UNSUPPORTED;
        }
        s->bootloader_asked = true;
        s->bootloader_us = now_us;
        return 0;
    default:
        return MESSAGE_NACK_REASON_UNSUPPORTED;
    }
    session_use_staged(s);
    return reason;
}
