/* The pilot, by his radio receiver: its sticks set setpoint and commands, its switch arms and disarms, and a
 * run begins for it without a host. Where no system of the image may have a receiver there is no pilot. */
#ifndef PLUMB_LINK_PILOT_H
#define PLUMB_LINK_PILOT_H

#include "session_state.h"

#define SESSION_ALONE_US 1000000U /* without a run for so long the board begins one for its pilot */

#if USED_RECEIVER
/* Fetch and handle what came on the lines of the receiver. In a run in real time of a system that has one,
 * while the parameter `receiver` is not 0, they set setpoint and commands, and no host does. Its switch arms
 * (session_follow_pilot()). Call on every whole turn. */
void session_receive_pilot(session_t *s, uint32_t now_us);

/* The sticks of a run in real time are the receiver's. Call after every poll of what they reached. */
void session_take_sticks(session_t *s);

/* Follow the pilot's switch. locked: the switch of the board is closed. Call while session_has_receiver(). */
void session_follow_pilot(session_t *s, bool locked, uint32_t now_us);

/* End the run that the board has begun for a pilot, unless it is armed: a host asks for something that waits
 * for the end of a run. */
void session_end_alone(session_t *s, uint32_t now_us);

/* Who steers, by the parameters in use; when they have changed, pass what this was before. */
uint32_t session_pilot(const session_t *s);
void session_pilot_changed(session_t *s, uint32_t before);
#else
static inline void session_receive_pilot(session_t *s, uint32_t now_us) {
    (void)s, (void)now_us;
}
static inline void session_take_sticks(session_t *s) {
    (void)s;
}
static inline void session_follow_pilot(session_t *s, bool locked, uint32_t now_us) {
    (void)s, (void)locked, (void)now_us;
}
static inline void session_end_alone(session_t *s, uint32_t now_us) {
    (void)s, (void)now_us;
}
static inline uint32_t session_pilot(const session_t *s) {
    (void)s;
    return 0;
}
static inline void session_pilot_changed(session_t *s, uint32_t before) {
    (void)s, (void)before;
}
#endif

#endif
