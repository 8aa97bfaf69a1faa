/* CRC-32 (IEEE 802.3, as zlib.crc32): polynomial 0xEDB88320 reflected, initial and final complement. */
#ifndef PLUMB_CORE_DIGEST_H
#define PLUMB_CORE_DIGEST_H

#include <stddef.h>
#include <stdint.h>

uint32_t digest_crc32(const void *data, size_t bytes);

#endif
