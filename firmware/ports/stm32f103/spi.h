/* SPI1 as master: one access at a time, by DMA; the caller limits its time. */
#ifndef PLUMB_STM32F103_SPI_H
#define PLUMB_STM32F103_SPI_H

#include <stdint.h>

void spi_init(void);

/* Set the clock to PCLK2 / 2^(1 + divider), 0 to 7, while nothing is exchanged; before the first exchange. */
void spi_divide(uint32_t divider);

/* Start to exchange bytes in place; the end raises the interrupt of DMA1 channel 2. */
void spi_exchange(uint8_t *bytes, uint32_t count);

/* Deselect the chip and stop the DMA: after the end of an exchange, or to abort it. */
void spi_end(void);

#endif
