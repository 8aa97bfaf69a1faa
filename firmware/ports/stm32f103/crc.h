/* CRC unit of the chip. It has a single remainder, so only the main loop may use it. */
#ifndef PLUMB_STM32F103_CRC_H
#define PLUMB_STM32F103_CRC_H

#include <stdint.h>

/* The unit's remainder over the words from `from` to `end`, a multiple of four words. */
uint32_t crc_of_words(const uint32_t *from, const uint32_t *end);

#endif
