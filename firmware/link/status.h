/* Status: what the board reported last, and the periodic frames that tell it: TIME every STATUS_TIME_US, and
 * every STATUS_PERIOD_US STATUS, COUNTERS, EVENTS, CAN_HEALTH and SENSORS to each open link. Times are in us
 * of the board's clock, modulo 2^32. */
#ifndef PLUMB_LINK_STATUS_H
#define PLUMB_LINK_STATUS_H

#include "app/board.h"
#include "app/board_links.h"
#include "app/board_sensors.h"
#include "generated/messages.h"
#include "routing.h"

#define STATUS_TIME_US   50000U
#define STATUS_PERIOD_US 100000U

typedef struct {
    uint32_t faults;               /* BOARD_FAULT_* at this moment */
    const board_can_health_t *can; /* NULL: there is no CAN; kept by the caller */
    board_health_t sensors;
    uint32_t time_us;   /* last TIME */
    uint32_t status_us; /* last STATUS */
} status_t;

/* Call each on every turn of the loop: true when TIME, or STATUS and what goes with it, is due now. */
bool status_time_due(status_t *s, uint32_t now_us);
bool status_due(status_t *s, uint32_t now_us);

/* STATUS with the given mode, blocked and flags; EVENTS; and what the board reported and the link counted. */
void status_send(const status_t *s, const routing_link_t *link, message_status_t status, uint8_t flags,
                 const message_events_t *events);

#endif
