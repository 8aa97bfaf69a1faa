/* The application: what every port runs after its reset.
 *
 *     loop_start();
 *     for (;;) {
 *         loop_turn();
 *     }
 */
#ifndef PLUMB_LOOP_H
#define PLUMB_LOOP_H

/* Load the saved parameters, start the board (board_init()), and open the session. Static memory is zero. */
void loop_start(void);

/* One turn: check the memory, receive, poll the session, run the steps that are due, actuate, transmit; then
 * sleep in board_idle() until there may be something to do. */
void loop_turn(void);

#endif
