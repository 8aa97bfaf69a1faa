/* CRC unit of the chip. It holds a single remainder: for the main loop only. */
#ifndef PLUMB_STM32F103_CRC_H
#define PLUMB_STM32F103_CRC_H

#include <stdint.h>

/* The unit's remainder over whole words, in fours. */
uint32_t crc_of_words(const uint32_t *from, const uint32_t *end);

#endif
