/* The digest is CRC-32 as zlib computes it: published check value, bit-by-bit definition, every byte
 * position. */
#include "core/digest.h"
#include <stdio.h>
#include <string.h>

static uint32_t by_definition(const uint8_t *bytes, size_t count) {
    uint32_t crc = 0xffffffffU;
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ ((crc & 1U) != 0U ? 0xedb88320U : 0U);
        }
    }
    return ~crc;
}

int main(void) {
    int wrong = 0;
    wrong += digest_crc32("", 0) != 0U;
    wrong += digest_crc32("123456789", 9) != 0xcbf43926U; /* the check value of CRC-32/ISO-HDLC */

    uint8_t bytes[512];
    uint32_t state = 1U;
    for (size_t i = 0; i < sizeof bytes; i++) {
        state = state * 1664525U + 1013904223U;
        bytes[i] = (uint8_t)(state >> 24);
    }
    for (size_t start = 0; start < 4; start++) {
        for (size_t count = 0; start + count <= sizeof bytes; count++) {
            wrong += digest_crc32(bytes + start, count) != by_definition(bytes + start, count);
        }
    }
    /* One flipped bit anywhere is seen. */
    const uint32_t before = digest_crc32(bytes, sizeof bytes);
    for (size_t bit = 0; bit < 8 * sizeof bytes; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1U << (bit % 8));
        wrong += digest_crc32(bytes, sizeof bytes) == before;
        bytes[bit / 8] ^= (uint8_t)(1U << (bit % 8));
    }
    if (wrong != 0) {
        printf("digest: %d wrong\n", wrong);
    }
    return wrong != 0;
}
