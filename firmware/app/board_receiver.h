/* The lines of a radio receiver: bytes, or pulses. Images without a system that it may fly have none of this.
 */
#ifndef PLUMB_BOARD_RECEIVER_H
#define PLUMB_BOARD_RECEIVER_H

#include <stddef.h>
#include <stdint.h>

/* Fetch received bytes, at most `room`; returns how many. 24 us or more lie between two bytes, and 256 of
 * them are kept: call on every whole turn of the loop, or bytes are lost after 6 ms. */
size_t board_receiver_read(uint8_t *bytes, size_t room);

/* Fetch the rising edges of the receiver's pulse train, in us modulo 2^16, at most `room`; returns how many.
 * 32 of them are kept: call on every whole turn of the loop. */
size_t board_receiver_edges(uint16_t *stamps_us, size_t room);

#endif
