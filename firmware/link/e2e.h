/* CAN frame with end-to-end protection: CRC-8 in byte 0, 4-bit counter in byte 1.
 *
 * CRC-8 polynomial 0x2F, initial value and final XOR 0xFF, over the identifier (2 bytes, big-endian), the
 * DLC, then bytes 7 to 1, each least significant bit first; byte 0 holds the CRC bit-reversed. CAN sends byte
 * 0 first and the most significant bit of each byte first, so that payload and CRC are one code word, read
 * backwards on the wire: every burst of up to 8 bits and every error of 1 to 3 bits is detected. The CRC
 * covers identifier and length, so a frame that arrives under another identifier is rejected, too. */
#ifndef PLUMB_LINK_E2E_H
#define PLUMB_LINK_E2E_H

#include <stdbool.h>
#include <stdint.h>

#define CAN_FRAME_DLC    8U     /* every frame of this protocol */
#define CAN_ID_MAX       0x7FFU /* standard identifiers, 11 bits */
#define E2E_COUNTER_MASK 0x0FU  /* low nibble of byte 1; the high nibble is four flags */

typedef struct {
    uint16_t id;     /* 0..CAN_ID_MAX */
    uint8_t dlc;     /* 0..8 */
    uint8_t data[8]; /* dlc bytes count, the others are 0 */
} can_frame_t;

/* The right value of byte 0. Covers bytes 1 to 7, whatever the DLC, and ignores data[0]. */
uint8_t e2e_crc8(const can_frame_t *frame);

/* Put counter (0..15) and flags (0..15) into byte 1 and the CRC into byte 0; sets dlc to 8. */
void e2e_seal(can_frame_t *frame, uint8_t counter, uint8_t flags);

/* True when the length is 8 and the CRC is right. */
bool e2e_check(const can_frame_t *frame);

static inline uint8_t e2e_counter(const can_frame_t *frame) {
    return (uint8_t)(frame->data[1] & E2E_COUNTER_MASK);
}

static inline uint8_t e2e_flags(const can_frame_t *frame) {
    return (uint8_t)(frame->data[1] >> 4);
}

#endif
