/* Status: the last state of the board, and the frames that report it. TIME goes out every STATUS_TIME_US;
 * STATUS, COUNTERS, EVENTS, CAN_HEALTH, SENSORS and PLAUSIBILITY go to each open link every STATUS_PERIOD_US.
 * A frame in which an event changed goes out at once: a fault must not wait for 100 ms. Times are in us of
 * the board's clock, modulo 2^32. */
#ifndef PLUMB_LINK_STATUS_H
#define PLUMB_LINK_STATUS_H

#include "app/board.h"
#include "app/board_links.h"
#include "app/board_sensors.h"
#include "generated/messages.h"
#include "routing.h"

#define STATUS_TIME_US   50000U
#define STATUS_PERIOD_US 100000U

/* Shortest time between two frames of one kind that are sent because of a change: of a state (faults, armed,
 * cause of disarming, cause of a sensor's fault), and of a counter, which may count for as long as its cause
 * lasts. */
#define STATUS_STATE_US 2000U
#define STATUS_COUNT_US 20000U

/* Event of a frame as last sent: its state and its count, packed. */
typedef struct {
    uint32_t state;
    uint32_t count;
    uint32_t changed_us; /* last time it was sent because of a change */
} status_sent_t;

/* Events as last sent on one link; a change while it is closed is sent when it opens. */
typedef struct {
    status_sent_t status;
    status_sent_t counters;
    status_sent_t events;
    status_sent_t can;
    status_sent_t sensors;
    status_sent_t plausibility;
} status_news_t;

typedef struct {
    uint32_t faults;               /* present BOARD_FAULT_* */
    const board_can_health_t *can; /* in memory that the caller keeps; NULL: there is no CAN */
    board_health_t sensors;
    bool injected;      /* the analog inputs of `sensors` are the channels of injected samples */
    uint32_t time_us;   /* of the last TIME */
    uint32_t status_us; /* of the last STATUS */
} status_t;

/* True when TIME, or STATUS with the frames that follow it, is due. Call both on every whole turn of the
 * loop. */
bool status_time_due(status_t *s, uint32_t now_us);
bool status_due(status_t *s, uint32_t now_us);

/* A link, and which frames are due on it now. */
typedef struct {
    const routing_link_t *link;
    status_news_t *news;
    uint32_t now_us;
    bool all;    /* STATUS_PERIOD_US are over */
    bool counts; /* a changed counter is sent at once, too: a run in real time is on */
} status_round_t;

/* False when status_send() will not send STATUS: what it says need not be found out then. */
bool status_goes(const status_t *s, const status_round_t *round, uint8_t flags);

/* Call on every whole turn of the loop for an open link: sends the frames that are due. status, flags: mode,
 * blocked and flags of STATUS; its faults are filled in. */
void status_send(const status_t *s, const status_round_t *round, message_status_t *status, uint8_t flags,
                 const message_events_t *events, const message_plausibility_t *plausibility);

#endif
