/* Watch over the main loop while the actuators may move: board_turn() of app/board.h. */
#ifndef PLUMB_STM32F103_STALL_H
#define PLUMB_STM32F103_STALL_H

#include <stdbool.h>

/* Call every millisecond from SysTick. True while the outputs must be neutral because the loop stalled. */
bool stall_tick(void);

/* Begin or end the watch. driving: the actuators may move; false: they are at neutral. */
void stall_watch(bool driving);

/* True after the loop stalled: nothing may move until stall_clear(). */
bool stall_latched(void);

/* True while the outputs may be away from neutral. */
bool stall_watches(void);

/* Call at the start of a run. */
void stall_clear(void);

#endif
