#include "status.h"

static bool due(uint32_t *last_us, uint32_t period_us, uint32_t now_us) {
    const bool is_due = now_us - *last_us >= period_us;

    *last_us = is_due ? now_us : *last_us;
    return is_due;
}

bool status_time_due(status_t *s, uint32_t now_us) {
    return due(&s->time_us, STATUS_TIME_US, now_us);
}

bool status_due(status_t *s, uint32_t now_us) {
    return due(&s->status_us, STATUS_PERIOD_US, now_us);
}

void status_send(const status_t *s, const routing_link_t *l, message_status_t status, uint8_t flags,
                 const message_events_t *events) {
    const message_counters_t counters = {
        .rejected = l->rejected, .lost = l->lost, .dropped = l->outbox->dropped};
    const message_sensors_t sensors = {
        .analog = (uint16_t)(s->sensors.railed | (unsigned)s->sensors.stuck << 8),
        .digital = (uint16_t)(s->sensors.gyro | (unsigned)s->sensors.accel << 8),
        .bus_failures = s->sensors.bus_failures};

    status.faults = (uint16_t)(s->faults & 0xFFFFU);
    outbox_telemetry(l->outbox, message_status_pack(&status), flags);
    outbox_telemetry(l->outbox, message_counters_pack(&counters), 0);
    outbox_telemetry(l->outbox, message_events_pack(events), 0);
    if (s->can != NULL) {
        const message_can_health_t health = {.transmit_errors = s->can->transmit_errors,
                                             .receive_errors = s->can->receive_errors,
                                             .bus_offs = s->can->bus_offs};
        const unsigned off = s->can->bus_off ? MESSAGE_CAN_HEALTH_BUS_OFF : 0U;

        outbox_telemetry(l->outbox, message_can_health_pack(&health), (uint8_t)(s->can->last_error | off));
    }
    outbox_telemetry(l->outbox, message_sensors_pack(&sensors), 0);
}
