#include "e2e.h"

/* Mirrored CRC-8 0x2F of each low nibble and of each high one; that of a byte is their sum. 32 bytes of
 * flash. */
static const uint8_t low_crc8[16] = {0x00, 0xC7, 0x67, 0xA0, 0xCE, 0x09, 0xA9, 0x6E,
                                     0x75, 0xB2, 0x12, 0xD5, 0xBB, 0x7C, 0xDC, 0x1B};
static const uint8_t high_crc8[16] = {0x00, 0xEA, 0x3D, 0xD7, 0x7A, 0x90, 0x47, 0xAD,
                                      0xF4, 0x1E, 0xC9, 0x23, 0x8E, 0x64, 0xB3, 0x59};

static inline uint8_t crc8_byte(uint8_t crc, uint8_t byte) {
    crc ^= byte;
    return low_crc8[crc & 15U] ^ high_crc8[crc >> 4];
}

uint8_t e2e_crc8(const can_frame_t *frame) {
    uint8_t crc = 0xFFU;

    crc = crc8_byte(crc, (uint8_t)(frame->id >> 8));
    crc = crc8_byte(crc, (uint8_t)(frame->id & 0xFFU));
    crc = crc8_byte(crc, frame->dlc);
    for (unsigned i = CAN_FRAME_DLC - 1U; i > 0; i--) {
        crc = crc8_byte(crc, frame->data[i]);
    }
    return crc ^ 0xFFU;
}

void e2e_seal(can_frame_t *frame, uint8_t counter, uint8_t flags) {
    frame->dlc = CAN_FRAME_DLC;
    frame->data[1] = (uint8_t)((counter & E2E_COUNTER_MASK) | ((unsigned)flags << 4));
    frame->data[0] = e2e_crc8(frame);
}

bool e2e_check(const can_frame_t *frame) {
    return frame->dlc == CAN_FRAME_DLC && frame->data[0] == e2e_crc8(frame);
}
