/* Echo by DMA both ways: circular reception with IDLE, half and full interrupts, transmission in bursts. */
#include "part.h"
RESULTS;
static uint8_t received[64], sending[64];
static volatile uint32_t wakes;

void usart1_handler(void) {
    results[1] |= USART1_SR;
    (void)USART1_DR;
    wakes++;
}

void dma1_channel5_handler(void) {
    results[2] |= DMA_ISR;
    DMA_IFCR = 0xFU << 16;
    wakes++;
}

void dma1_channel4_handler(void) {
    DMA_IFCR = 0xFU << 12;
    results[3]++;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    clock_72mhz();
    RCC_APB2ENR = 1U << 14 | 1U << 2 | 1;
    RCC_AHBENR |= 1;
    GPIOA_CRH = 0x444444B4U;
    USART1_BRR = 78;
    USART1_CR3 = 0xC1;
    DMA_CPAR(5) = 0x40013804;
    DMA_CMAR(5) = (uint32_t)(uintptr_t)received;
    DMA_CNDTR(5) = sizeof received;
    DMA_CCR(5) = 0xA7;
    DMA_CPAR(4) = 0x40013804;
    NVIC_ISER(0) = 1U << 14 | 1U << 15;
    NVIC_ISER(1) = 1U << 5;
    USART1_CR1 = 1U << 13 | 1U << 4 | 12;
    results[0] = 1;
    uint32_t tail = 0;
    for (;;) {
        uint32_t head = sizeof received - DMA_CNDTR(5);
        uint32_t count = 0;
        if (!(DMA_CCR(4) & 1) || DMA_CNDTR(4) == 0) {
            while (tail != head && count < sizeof sending) {
                sending[count++] = received[tail++ % sizeof received];
                tail %= sizeof received;
            }
        }
        if (count > 0) {
            DMA_CCR(4) = 0;
            DMA_CMAR(4) = (uint32_t)(uintptr_t)sending;
            DMA_CNDTR(4) = count;
            DMA_CCR(4) = 0x93;
        } else {
            irq_off();
            if (sizeof received - DMA_CNDTR(5) == head) {
                wait_for_interrupt();
            }
            irq_on();
        }
    }
}
