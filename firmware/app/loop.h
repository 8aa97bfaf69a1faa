/* The application: what every port runs after its reset.
 *
 *     loop_start();
 *     for (;;) {
 *         loop_turn();
 *         board_idle();
 *     }
 */
#ifndef PLUMB_LOOP_H
#define PLUMB_LOOP_H

#include "link/session.h"

/* Load the saved parameters, start the board (board_init()), and open the session. Static memory is zero. */
void loop_start(void);

/* One turn: check the memory, receive, poll the session, run the steps that are due, actuate, transmit. The
 * caller sleeps in board_idle() between two turns, so that no return address of a turn lies on the stack
 * meanwhile: the stack has no check word. */
void loop_turn(void);

/* The session, for a port that shows its state. */
const session_t *loop_session(void);

#endif
