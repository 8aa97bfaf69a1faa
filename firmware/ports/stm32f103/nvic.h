/* Interrupt controller, and the memory fence for data shared with interrupts. All handlers but SysTick's have
 * one priority, so none interrupts another; SysTick interrupts all of them. */
#ifndef PLUMB_STM32F103_NVIC_H
#define PLUMB_STM32F103_NVIC_H

#include "stm32f103.h"

#define NVIC_PRIORITY 0x80U /* of 0, the highest, to 0xf0; SysTick's is 0 */

static inline void nvic_enable(uint32_t irq) {
    NVIC_IPR(irq / 4U) |= NVIC_PRIORITY << 8U * (irq % 4U);
    NVIC_ISER(irq / 32U) = 1U << (irq % 32U);
}

/* Drop a pending interrupt, after its cause was stopped. */
static inline void nvic_forget(uint32_t irq) {
    NVIC_ICPR(irq / 32U) = 1U << (irq % 32U);
}

/* The compiler may not move memory accesses across this; the processor keeps their order anyway. */
static inline void memory_fence(void) {
    __asm volatile("" ::: "memory");
}

#endif
