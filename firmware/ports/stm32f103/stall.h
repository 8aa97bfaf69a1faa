/* Watch over the main loop while the actuators may move: board_turn() of app/board.h. */
#ifndef PLUMB_STM32F103_STALL_H
#define PLUMB_STM32F103_STALL_H

#include <stdbool.h>

/* From the interrupt of the millisecond. True while the outputs must be neutral: the loop did not come round.
 */
bool stall_tick(void);

/* driving: the actuators may move; else they are at neutral. */
void stall_watch(bool driving);

/* True after the loop did not come round: nothing may move until the next run. */
bool stall_latched(void);

void stall_clear(void);

#endif
