/* Three channels, triggered by TIM3 at 1 kHz, by DMA into a ring of two scans. */
#include "part.h"
RESULTS;
static volatile uint16_t scans[6];

void dma1_channel1_handler(void) {
    uint32_t flags = DMA_ISR & 0xF;
    DMA_IFCR = 0xF;
    const volatile uint16_t *scan = flags & 2 ? &scans[3] : &scans[0];
    results[0]++;
    for (uint32_t i = 0; i < 3; i++) {
        results[1 + i] = scan[i];
    }
    results[4] = TIM_CNT(TIM3); /* timer counts of 1 us since the trigger */
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    clock_72mhz();
    RCC_APB2ENR = 1U << 9 | 1U << 2 | 1;
    RCC_APB1ENR = 1U << 1;
    RCC_AHBENR |= 1;
    GPIOA_CRL = 0x44444000U;
    ADC_CR2 = 1;
    for (volatile uint32_t i = 0; i < 50; i++) {
    }
    ADC_CR2 = 1 | 8;
    while (ADC_CR2 & 8) {
    }
    ADC_CR2 = 1 | 4;
    while (ADC_CR2 & 4) {
        results[5]++;
    }
    ADC_SMPR2 = 0x1FF; /* 239.5 cycles on channels 0 to 2 */
    ADC_SQR1 = 2U << 20;
    ADC_SQR3 = 0U | 1U << 5 | 2U << 10;
    ADC_CR1 = 1U << 8;
    ADC_CR2 = 1 | 1U << 8 | 4U << 17 | 1U << 20;
    DMA_CPAR(1) = 0x4001244C;
    DMA_CMAR(1) = (uint32_t)(uintptr_t)scans;
    DMA_CNDTR(1) = 6;
    DMA_CCR(1) = 1U << 10 | 1U << 8 | 0xA7;
    NVIC_ISER(0) = 1U << 11;
    TIM_PSC(TIM3) = 71;
    TIM_ARR(TIM3) = 999;
    TIM_EGR(TIM3) = 1;
    TIM_CR2(TIM3) = 2U << 4;
    TIM_CR1(TIM3) = 1;
    for (;;) {
        wait_for_interrupt();
    }
}
