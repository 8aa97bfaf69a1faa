/* Status: the last reported state of the board, and its periodic frames: TIME every STATUS_TIME_US; STATUS,
 * COUNTERS, EVENTS, CAN_HEALTH and SENSORS every STATUS_PERIOD_US, to each open link. Times are in us of the
 * board's clock, modulo 2^32. */
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
    uint32_t faults;               /* present BOARD_FAULT_* */
    const board_can_health_t *can; /* in memory that the caller keeps; NULL: there is no CAN */
    board_health_t sensors;
    uint32_t time_us;   /* of the last TIME */
    uint32_t status_us; /* of the last STATUS */
} status_t;

/* True when TIME, or STATUS with the frames that follow it, is due. Call both on every turn of the loop. */
bool status_time_due(status_t *s, uint32_t now_us);
bool status_due(status_t *s, uint32_t now_us);

/* Send STATUS with the given mode, blocked and flags, COUNTERS of the link, EVENTS, CAN_HEALTH and SENSORS.
 */
void status_send(const status_t *s, const routing_link_t *link, message_status_t status, uint8_t flags,
                 const message_events_t *events);

#endif
