/* CRC-32 (IEEE 802.3: reflected 0xEDB88320, initial and final complement), the checksum of zlib. */
#ifndef PLUMB_CORE_DIGEST_H
#define PLUMB_CORE_DIGEST_H

#include <stddef.h>
#include <stdint.h>

uint32_t digest_crc32(const void *data, size_t bytes);

#endif
