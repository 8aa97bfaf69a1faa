/* Whether the session may arm its board, for whom, and why not. */
#ifndef PLUMB_LINK_ARMING_REASONS_H
#define PLUMB_LINK_ARMING_REASONS_H

#include "session_state.h"

#define SESSION_FAULTS_BLOCKING 0xE0FFU /* of BOARD_FAULT_*: these disarm, */
#define SESSION_FAULTS_FLOWN    0x6000U /* and these alone a board that a pilot armed: STALLED, UPSET */

bool session_armed(const session_t *s);

/* The system whose sensors are checked, the one in use; NULL: nothing is checked. */
const control_system_t *session_checked(const session_t *s);

/* True when the board started with the pin set of the actuator that the system drives. */
bool session_actuator_present(const session_t *s);

/* True when a pilot's receiver steers the system: it may have one, and the parameter `receiver` chooses one.
 */
#if USED_RECEIVER
bool session_has_receiver(const session_t *s);
#else
static inline bool session_has_receiver(const session_t *s) {
    (void)s;
    return false;
}
#endif

/* True while a pilot's switch holds the board armed. Then no host ends or begins a run, and the link of a
 * host does not matter. Of the faults of a board that flies only SESSION_FAULTS_FLOWN, and steps that do not
 * come, disarm: in the air a reason that is none is a crash. Its step handles lost sensors and a lost
 * receiver. */
bool session_piloted(const session_t *s);

/* The same for a vehicle in the air: one on wheels is safe when it is off. */
bool session_flown(const session_t *s);

/* ARMING_BLOCK_* for the host of a link; LINK_NONE: without a host. */
uint16_t session_arming_blocked(const session_t *s, link_t link);

/* How long the outputs stay at neutral after arming. */
uint32_t session_hold_us(const session_t *s);

/* Arm for the host of this request; false when *blocked (ARMING_BLOCK_*) is not 0. */
bool session_arm(session_t *s, const request_t *q, uint16_t *blocked);

/* A link can no longer control: if its host armed the board, disarm at once, for this cause. */
void session_link_lost(session_t *s, link_t link, uint16_t cause);

#endif
