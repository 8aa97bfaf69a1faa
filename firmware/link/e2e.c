#include "e2e.h"

/* CRC-8 0x2F of each high nibble: two look-ups a byte, 16 bytes of flash. */
static const uint8_t nibble_crc8[16] = {0x00, 0x2F, 0x5E, 0x71, 0xBC, 0x93, 0xE2, 0xCD,
                                        0x57, 0x78, 0x09, 0x26, 0xEB, 0xC4, 0xB5, 0x9A};

static uint8_t crc8_byte(uint8_t crc, uint8_t byte) {
    crc ^= byte;
    crc = (uint8_t)((unsigned)crc << 4) ^ nibble_crc8[crc >> 4];
    return (uint8_t)((unsigned)crc << 4) ^ nibble_crc8[crc >> 4];
}

uint8_t e2e_crc8(const can_frame_t *frame) {
    uint8_t crc = 0xFFU;

    crc = crc8_byte(crc, (uint8_t)(frame->id >> 8));
    crc = crc8_byte(crc, (uint8_t)(frame->id & 0xFFU));
    crc = crc8_byte(crc, frame->dlc);
    for (unsigned i = 1; i < CAN_FRAME_DLC; i++) {
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
