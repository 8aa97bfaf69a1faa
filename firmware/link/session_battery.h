/* What the session does with the battery. Where no system has one there is no session_battery.c. */
#ifndef PLUMB_LINK_SESSION_BATTERY_H
#define PLUMB_LINK_SESSION_BATTERY_H

#include "session_state.h"

#if USED_BATTERY
/* Read the battery; `readiness.outside` gets what keeps the vehicle on the ground, READINESS_BATTERY_. Call
 * on every whole turn. */
void session_follow_battery(session_t *s, uint32_t now_us);

/* Send BATTERY to one open link, if a battery is declared. */
void session_send_battery(const session_t *s, link_t link);
#else
static inline void session_follow_battery(session_t *s, uint32_t now_us) {
    (void)s, (void)now_us;
}
static inline void session_send_battery(const session_t *s, link_t link) {
    (void)s, (void)link;
}
#endif

#endif
