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

/* True when a frame is to be sent now: its period is over, or its event changed. A change that finds no room
 * waits for the next call. */
static bool send_now(const status_round_t *round, status_sent_t *sent, uint32_t state, uint32_t count) {
    const uint32_t since_us = round->now_us - sent->changed_us;
    const bool changed = (state != sent->state && since_us >= STATUS_STATE_US) ||
                         (round->counts && count != sent->count && since_us >= STATUS_COUNT_US);

    if (!round->all && !changed) {
        return false;
    }
    if (!outbox_telemetry_fits(round->link->outbox, 1)) {
        return round->all; /* to be counted as dropped */
    }
    sent->state = state;
    sent->count = count;
    sent->changed_us = changed ? round->now_us : sent->changed_us;
    return true;
}

/* Two values of 16 bits as one state or count. */
static uint32_t both(uint16_t low, uint16_t high) {
    return low | (uint32_t)high << 16;
}

/* One function for each kind, not inlined, so that only one frame at a time is on the stack. */
#define ONE_KIND __attribute__((noinline)) static void

/* The state of which a change sends STATUS. */
static uint32_t state_of(const status_t *s, uint8_t flags) {
    return both((uint16_t)(s->faults & 0xFFFFU), flags & MESSAGE_STATUS_ARMED);
}

bool status_goes(const status_t *s, const status_round_t *round, uint8_t flags) {
    return round->all || state_of(s, flags) != round->news->status.state;
}

ONE_KIND send_state(const status_round_t *round, const message_status_t *m, uint32_t state, uint8_t flags) {
    if (send_now(round, &round->news->status, state, 0)) {
        outbox_telemetry(round->link->outbox, message_status_pack(m), flags);
    }
}

ONE_KIND send_counters(const status_round_t *round) {
    const routing_link_t *const l = round->link;
    const message_counters_t m = {.rejected = l->rejected, .lost = l->lost, .dropped = l->outbox->dropped};

    if (send_now(round, &round->news->counters, 0, both(m.rejected, m.lost))) {
        outbox_telemetry(l->outbox, message_counters_pack(&m), 0);
    }
}

ONE_KIND send_events(const status_round_t *round, const message_events_t *m) {
    if (send_now(round, &round->news->events, m->disarm_cause, 0)) {
        outbox_telemetry(round->link->outbox, message_events_pack(m), 0);
    }
}

ONE_KIND send_can(const status_round_t *round, const board_can_health_t *can) {
    const message_can_health_t m = {.transmit_errors = can->transmit_errors,
                                    .receive_errors = can->receive_errors,
                                    .bus_offs = can->bus_offs};
    const unsigned off = can->bus_off ? MESSAGE_CAN_HEALTH_BUS_OFF : 0U;

    if (send_now(round, &round->news->can, off, m.bus_offs)) {
        outbox_telemetry(round->link->outbox, message_can_health_pack(&m), (uint8_t)(can->last_error | off));
    }
}

ONE_KIND send_sensors(const status_round_t *round, const board_health_t *health, bool injected) {
    const message_sensors_t m = {.analog = (uint16_t)(health->railed | (unsigned)health->stuck << 8),
                                 .digital = (uint16_t)(health->gyro | (unsigned)health->accel << 8),
                                 .bus_failures = health->bus_failures};

    if (send_now(round, &round->news->sensors, both(m.analog, m.digital), m.bus_failures)) {
        outbox_telemetry(round->link->outbox, message_sensors_pack(&m),
                         injected ? MESSAGE_SENSORS_INJECTED : 0U);
    }
}

ONE_KIND send_plausibility(const status_round_t *round, const message_plausibility_t *m) {
    if (send_now(round, &round->news->plausibility, both(m->failed, m->disarmed_by), 0)) {
        outbox_telemetry(round->link->outbox, message_plausibility_pack(m), 0);
    }
}

void status_send(const status_t *s, const status_round_t *round, message_status_t *status, uint8_t flags,
                 const message_events_t *events, const message_plausibility_t *plausibility) {
    status->faults = (uint16_t)(s->faults & 0xFFFFU);
    send_state(round, status, state_of(s, flags), flags);
    send_counters(round);
    send_events(round, events);
    if (s->can != NULL) {
        send_can(round, s->can);
    }
    send_sensors(round, &s->sensors, s->injected);
    send_plausibility(round, plausibility);
}
