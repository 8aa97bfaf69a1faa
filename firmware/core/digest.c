#include "digest.h"

/* CRC of each nibble, least significant bit first: polynomial 0x04c11db7 reflected, 0xedb88320. A table for
 * whole bytes would be twice as fast and 960 bytes larger. */
static const uint32_t remainder_of[16] = {
    0x00000000U, 0x1db71064U, 0x3b6e20c8U, 0x26d930acU, 0x76dc4190U, 0x6b6b51f4U, 0x4db26158U, 0x5005713cU,
    0xedb88320U, 0xf00f9344U, 0xd6d6a3e8U, 0xcb61b38cU, 0x9b64c2b0U, 0x86d3d2d4U, 0xa00ae278U, 0xbdbdf21cU,
};

uint32_t digest_crc32(const void *data, size_t bytes) {
    const uint8_t *const input = data;
    uint32_t crc = 0xffffffffU;
    for (size_t i = 0; i < bytes; i++) {
        crc ^= input[i];
        crc = (crc >> 4) ^ remainder_of[crc & 15U];
        crc = (crc >> 4) ^ remainder_of[crc & 15U];
    }
    return ~crc;
}
