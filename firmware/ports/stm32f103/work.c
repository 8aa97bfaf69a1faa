/* Work that waits for a turn of the loop. Images without an actuator have none of this: every turn is a whole
 * one. */
#include "app/board.h"
#include "bxcan.h"
#include "idle.h"
#include "uart.h"

volatile bool idle_news;

bool board_work_waits(void) {
    const bool news = idle_news;
    if (news) {
        idle_news = false;
    }
    return news || uart_bytes_wait() || can_frame_waits();
}
