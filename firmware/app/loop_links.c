#include "loop_links.h"
#include "board_links.h"
#include "generated/messages.h"
#include "link/requests.h"

#define UART_PER_TURN 64U /* bytes */
/* In real time one commit a turn, of 22 bytes: it takes 0.23 ms, the rest of a turn up to 0.2 ms, and a step
 * may be due every 0.5 ms. Two would make an armed board late, which disarms it. */
#define REALTIME_PER_TURN SLCAN_FRAME_CHARS
#define CAN_PER_TURN      16U /* frames: a flood of them must not keep the loop from its steps */

void loop_links_receive(session_t *s, uint32_t now_us) {
    uint8_t bytes[UART_PER_TURN];
    const size_t room = requests_room(s);
    const bool realtime = s->run.mode == RUN_REALTIME;
    const size_t most = realtime ? REALTIME_PER_TURN : UART_PER_TURN;
    const size_t count = board_uart_read(bytes, room < most ? room : most);
    requests_receive(s, bytes, count, now_us);

    can_frame_t frame;
    for (unsigned i = 0U; i < CAN_PER_TURN && requests_frame_room(s) && board_can_read(&frame); i++) {
        requests_receive_frame(s, &frame, now_us);
        if (realtime && frame.id == MESSAGE_PARAM_COMMIT_ID) {
            break; /* one commit a turn; board_work_waits() tells of the rest */
        }
    }
}

void loop_links_transmit(session_buffers_t *buffers) {
    uint8_t bytes[4U * SLCAN_FRAME_CHARS];
    size_t count, most;
    do {
        const size_t room = board_uart_room();
        most = room < sizeof bytes ? room : sizeof bytes;
        count = session_transmit(buffers, bytes, most);
        if (count > 0U) {
            (void)board_uart_write(bytes, count);
        }
    } while (count == most && most > 0U); /* else nothing is left, or no room */

    can_frame_t frame;
    while (board_can_room() && session_transmit_frame(buffers, &frame)) {
        board_can_send(&frame);
    }
}
