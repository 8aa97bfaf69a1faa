/* Work that waits for a turn of the loop. Images without an actuator have none of this: every turn is a whole
 * one. */
#include "app/board.h"
#include "bxcan.h"
#include "idle.h"
#include "uart.h"

bool board_work_waits(void) {
    return idle_news || uart_line_waits() || can_frame_waits();
}
