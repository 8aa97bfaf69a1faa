#include "loop_links.h"
#include "board_links.h"
#include "link/requests.h"

#define UART_PER_TURN 64U /* bytes */
/* In real time less than two requests of 22 bytes: a commit takes 0.17 ms, and a step may be due every
 * 0.5 ms. */
#define REALTIME_PER_TURN 32U
#define CAN_PER_TURN      16U /* frames: a flood of them must not keep the loop from its steps */

void loop_links_receive(session_t *s, uint32_t now_us) {
    uint8_t bytes[UART_PER_TURN];
    const size_t room = requests_room(s);
    const size_t most = s->run.mode == RUN_REALTIME ? REALTIME_PER_TURN : UART_PER_TURN;
    const size_t count = board_uart_read(bytes, room < most ? room : most);
    requests_receive(s, bytes, count, now_us);

    can_frame_t frame;
    for (unsigned i = 0U; i < CAN_PER_TURN && requests_frame_room(s) && board_can_read(&frame); i++) {
        requests_receive_frame(s, &frame, now_us);
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
