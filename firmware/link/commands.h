/* SLCAN commands of the UART: lines of text between the frames, each answered by CR (accepted) or BEL
 * (refused).
 *
 * O opens the link, L opens it read-only, C closes it. S and s set bit rates: accepted without effect. V and
 * N return version and serial number. */
#ifndef PLUMB_LINK_COMMANDS_H
#define PLUMB_LINK_COMMANDS_H

#include "routing.h"

typedef struct {
    slcan_rx_t rx;
    uint16_t serial_number;
} commands_t;

typedef enum {
    COMMANDS_NOTHING, /* all bytes were handled */
    COMMANDS_FRAME,   /* a well-formed frame, to be answered by commands_answer_frame() */
    COMMANDS_CLOSED   /* the UART was closed or opened read-only: its host can no longer control */
} commands_event_t;

/* unique_id: 96 bits; folded into a serial number of four hexadecimal digits. */
void commands_init(commands_t *c, const uint32_t unique_id[3]);

/* Number of bytes that commands_push() may get now, so that every reply has room. 0 while the host does not
 * read its replies. */
size_t commands_room(const routing_t *routing);

/* Handle the bytes from *at to end, or to the first event, and advance *at behind them. For COMMANDS_FRAME
 * the frame is in *frame; otherwise *frame is untouched. */
commands_event_t commands_push(commands_t *c, routing_t *routing, const uint8_t **at, const uint8_t *end,
                               can_frame_t *frame);

/* Answer a frame by CR when it was accepted, else by BEL. Call before queueing any reply to it. */
void commands_answer_frame(routing_t *routing, bool accepted);

#endif
