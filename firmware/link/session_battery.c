#include "session_battery.h"
#include "app/board_battery.h"

void session_follow_battery(session_t *s, uint32_t now_us) {
    uint16_t counts[BATTERY_INPUTS] = {0};
    const bool read = board_battery_read(counts);

    battery_follow(&s->battery, read, counts, now_us);
    s->readiness.outside = battery_missing(&s->battery, s->params);
}

void session_send_battery(const session_t *s, link_t link) {
    if (s->params->battery_min_mv != 0U) {
        const message_battery_t m = battery_message(&s->battery, s->params);

        outbox_telemetry(s->routing.link[link].outbox, message_battery_pack(&m), 0);
    }
}
