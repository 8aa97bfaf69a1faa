/* SPI1 as master in mode 3 on PA5 to PA7, chip select on PA4, one access at a time, by DMA both ways (RM0008
 * 25.3.5, 25.3.9). Bytes are exchanged in place: what was received replaces what was sent. */
#include "spi.h"
#include "nvic.h"
#include "stm32f103.h"

#define SELECT 4U

void spi_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_SPI1EN;
    DMA1_CPAR2 = (uint32_t)(uintptr_t)&SPI1_DR;
    DMA1_CPAR3 = (uint32_t)(uintptr_t)&SPI1_DR;
    nvic_enable(IRQ_DMA1_Channel2);
    SPI1_CR2 = SPI1_CR2_RXDMAEN | SPI1_CR2_TXDMAEN;
}

void spi_divide(uint32_t divider) {
    SPI1_CR1 = SPI1_CR1_SSM | SPI1_CR1_SSI | SPI1_CR1_MSTR | SPI1_CR1_CPOL | SPI1_CR1_CPHA |
               divider * SPI1_CR1_BR_LOWEST | SPI1_CR1_SPE;
}

void spi_exchange(uint8_t *bytes, uint32_t count) {
    memory_fence(); /* the bytes are in memory before the DMA reads them */
    /* Drop a byte left by an aborted exchange, which would shift all bytes by one. Reading DR, then SR clears
     * an overrun, too. */
    (void)SPI1_DR;
    (void)SPI1_SR;
    GPIOA_BSRR = 1U << (SELECT + 16U);
    DMA1_CMAR2 = (uint32_t)(uintptr_t)bytes;
    DMA1_CNDTR2 = count;
    DMA1_CCR2 = DMA1_CCR1_EN | DMA1_CCR1_MINC | DMA1_CCR1_TCIE | DMA1_CCR1_PL_HIGH;
    DMA1_CMAR3 = (uint32_t)(uintptr_t)bytes;
    DMA1_CNDTR3 = count;
    DMA1_CCR3 = DMA1_CCR1_EN | DMA1_CCR1_MINC | DMA1_CCR1_DIR;
}

void spi_end(void) {
    GPIOA_BSRR = 1U << SELECT;
    DMA1_CCR2 = 0U;
    DMA1_CCR3 = 0U;
    DMA1_IFCR = DMA1_IFCR_CGIF2 | DMA1_IFCR_CGIF3;
    memory_fence(); /* the bytes are read after the DMA has written them */
}
