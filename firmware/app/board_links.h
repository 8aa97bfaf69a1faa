/* The links to a host: bytes of the UART, frames of CAN. */
#ifndef PLUMB_BOARD_LINKS_H
#define PLUMB_BOARD_LINKS_H

#include "link/e2e.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Fetch received bytes, at most `room`; returns how many. */
size_t board_uart_read(uint8_t *bytes, size_t room);

/* How many bytes board_uart_write() would accept now. */
size_t board_uart_room(void);

/* Queue bytes for sending; returns how many were accepted. */
size_t board_uart_write(const uint8_t *bytes, size_t count);

/* Error state of the CAN controller (ISO 11898-1). */
typedef struct {
    uint8_t transmit_errors; /* the standard's error counters; bus_off is the ninth bit of this one */
    uint8_t receive_errors;
    uint8_t last_error; /* 0 none since, 1 stuff, 2 form, 3 acknowledgement, 4 bit recessive, 5 bit dominant,
                           6 CRC */
    bool bus_off;       /* not on the bus: for good without a crystal, else until the pause has passed */
    uint16_t bus_offs;  /* how often it went bus-off, modulo 2^16 */
} board_can_health_t;

/* Stay on the CAN bus at this rate, and receive these identifiers only. Call on every whole turn of the loop:
 * after bus-off this brings the board back, after a pause that doubles up to 1 s. kbit: a divisor of 2000
 * from 125 to 1000; the same values again change nothing. ids: up to 56, in memory that the caller keeps. */
void board_can_join(uint32_t kbit, const uint16_t *ids, size_t count);

/* The oldest received frame; false when there is none. */
bool board_can_read(can_frame_t *frame);

/* True when board_can_send() would take a frame. */
bool board_can_room(void);

/* Send a frame; frames go out in the order of the calls. A frame that nobody acknowledges for half a second
 * is dropped. */
void board_can_send(const can_frame_t *frame);

const board_can_health_t *board_can_health(void);

#endif
