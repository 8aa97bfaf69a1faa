/* Just the registers that the small programs use. RM0008 and Armv7-M. */
#ifndef TEST_PART_H
#define TEST_PART_H
#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(address))

#define NVIC_ISER(n)  REG(0xE000E100 + 4 * (n))
#define NVIC_ISPR(n)  REG(0xE000E200 + 4 * (n))
#define NVIC_IPR8(n)  (*(volatile uint8_t *)(0xE000E400 + (n)))
#define SCB_ICSR      REG(0xE000ED04)
#define SCB_AIRCR     REG(0xE000ED0C)
#define SCB_SHPR8(n)  (*(volatile uint8_t *)(0xE000ED18 + (n) - 4))
#define SCB_SHCSR     REG(0xE000ED24)
#define SCB_CFSR      REG(0xE000ED28)
#define SCB_HFSR      REG(0xE000ED2C)
#define SCB_BFAR      REG(0xE000ED38)
#define SYST_CSR      REG(0xE000E010)
#define SYST_RVR      REG(0xE000E014)
#define SYST_CVR      REG(0xE000E018)
#define DEMCR         REG(0xE000EDFC)
#define DWT_CTRL      REG(0xE0001000)
#define DWT_CYCCNT    REG(0xE0001004)
#define DBGMCU_IDCODE REG(0xE0042000)

#define RCC_CR      REG(0x40021000)
#define RCC_CFGR    REG(0x40021004)
#define RCC_CIR     REG(0x40021008)
#define RCC_AHBENR  REG(0x40021014)
#define RCC_APB2ENR REG(0x40021018)
#define RCC_APB1ENR REG(0x4002101C)
#define RCC_CSR     REG(0x40021024)
#define FLASH_ACR   REG(0x40022000)
#define AFIO_MAPR   REG(0x40010004)
#define GPIOA_CRL   REG(0x40010800)
#define GPIOA_CRH   REG(0x40010804)
#define GPIOB_CRL   REG(0x40010C00)
#define GPIOC_CRH   REG(0x40011004)
#define GPIOC_IDR   REG(0x40011008)
#define GPIOC_ODR   REG(0x4001100C)
#define GPIOC_BSRR  REG(0x40011010)
#define WWDG_CR     REG(0x40002C00)
#define WWDG_SR     REG(0x40002C08)
#define IWDG_KR     REG(0x40003000)
#define IWDG_PR     REG(0x40003004)
#define IWDG_RLR    REG(0x40003008)
#define IWDG_SR     REG(0x4000300C)

#define USART1_SR  REG(0x40013800)
#define USART1_DR  REG(0x40013804)
#define USART1_BRR REG(0x40013808)
#define USART1_CR1 REG(0x4001380C)
#define USART1_CR3 REG(0x40013814)

#define USART3_SR  REG(0x40004800)
#define USART3_DR  REG(0x40004804)
#define USART3_BRR REG(0x40004808)
#define USART3_CR1 REG(0x4000480C)

#define DMA_ISR      REG(0x40020000)
#define DMA_IFCR     REG(0x40020004)
#define DMA_CCR(n)   REG(0x40020008 + 20 * ((n) - 1))
#define DMA_CNDTR(n) REG(0x4002000C + 20 * ((n) - 1))
#define DMA_CPAR(n)  REG(0x40020010 + 20 * ((n) - 1))
#define DMA_CMAR(n)  REG(0x40020014 + 20 * ((n) - 1))

#define TIM3         0x40000400U
#define TIM4         0x40000800U
#define TIM_CR1(t)   REG((t) + 0x00)
#define TIM_CR2(t)   REG((t) + 0x04)
#define TIM_EGR(t)   REG((t) + 0x14)
#define TIM_CCMR1(t) REG((t) + 0x18)
#define TIM_CCER(t)  REG((t) + 0x20)
#define TIM_CNT(t)   REG((t) + 0x24)
#define TIM_PSC(t)   REG((t) + 0x28)
#define TIM_ARR(t)   REG((t) + 0x2C)
#define TIM_CCR1(t)  REG((t) + 0x34)
#define TIM_CCR2(t)  REG((t) + 0x38)

#define ADC_SR    REG(0x40012400)
#define ADC_CR1   REG(0x40012404)
#define ADC_CR2   REG(0x40012408)
#define ADC_SMPR2 REG(0x40012410)
#define ADC_SQR1  REG(0x4001242C)
#define ADC_SQR3  REG(0x40012434)
#define ADC_DR    REG(0x4001244C)

/* What the test reads; survives resets. */
extern volatile uint32_t results[64];
#define RESULTS __attribute__((section(".results"), used)) volatile uint32_t results[64]

static inline void irq_off(void) {
    __asm volatile("cpsid i" ::: "memory");
}

static inline void irq_on(void) {
    __asm volatile("cpsie i" ::: "memory");
}

static inline void wait_for_interrupt(void) {
    __asm volatile("wfi" ::: "memory");
}

/* 72 MHz from the crystal. */
static inline void clock_72mhz(void) {
    FLASH_ACR = 0x12;
    RCC_CR |= 1U << 16;
    while (!(RCC_CR & 1U << 17)) {
    }
    RCC_CFGR = 7U << 18 | 1U << 16 | 4U << 8 | 2U << 14;
    RCC_CR |= 1U << 24;
    while (!(RCC_CR & 1U << 25)) {
    }
    RCC_CFGR |= 2;
    while ((RCC_CFGR & 0xC) != 8) {
    }
}
#endif
