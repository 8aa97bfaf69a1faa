/* SLCAN commands of the UART: text around the frames, each line answered by CR or a bell.
 *
 * O opens the link, L opens it read-only, C closes it; S and s set bit rates that nothing has here; V and N
 * tell version and serial number. */
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
    COMMANDS_CLOSED   /* the UART was closed or opened read-only: nobody can control over it any more */
} commands_event_t;

/* unique_id: 96 bits; folded into a serial number of four digits, enough to tell boards apart. */
void commands_init(commands_t *c, const uint32_t unique_id[3]);

/* How many bytes commands_push() may be given now, so that every reply has room. 0 while the host does
 * not read. */
size_t commands_room(const routing_t *routing);

/* Handle bytes from *at up to end, or up to the first event; *at moves on. For COMMANDS_FRAME the frame is in
 * *frame; otherwise *frame is untouched. */
commands_event_t commands_push(commands_t *c, routing_t *routing, const uint8_t **at, const uint8_t *end,
                               can_frame_t *frame);

/* CR for an accepted frame, before any reply to it; a bell for a rejected one. */
void commands_answer_frame(routing_t *routing, bool accepted);

#endif
