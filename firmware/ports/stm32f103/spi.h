/* SPI1 as master: one access at a time, by DMA, bounded in time by the caller. */
#ifndef PLUMB_STM32F103_SPI_H
#define PLUMB_STM32F103_SPI_H

#include <stdint.h>

void spi_init(void);

/* Exchange bytes in place; its end raises the interrupt of DMA1 channel 2. */
void spi_exchange(uint8_t *bytes, uint32_t count);

/* After the end of an exchange, or to give one up. */
void spi_end(void);

#endif
