/* Crystal with a bounded wait, else HSI/2 x 16; reset flags, identity, cycle counter. */
#include "part.h"
RESULTS;

int main(void) {
    results[0] = RCC_CR;
    results[1] = RCC_CSR;
    results[2] = *(volatile uint16_t *)0x1FFFF7E0;
    results[3] = REG(0x1FFFF7E8);
    results[4] = DBGMCU_IDCODE;
    FLASH_ACR = 0x12;
    RCC_CR |= 1U << 16;
    uint32_t waited = 0;
    while (!(RCC_CR & 1U << 17) && waited < 20000) {
        waited++;
    }
    results[5] = waited;
    RCC_CFGR = RCC_CR & 1U << 17 ? 7U << 18 | 1U << 16 | 4U << 8 : 14U << 18 | 4U << 8;
    RCC_CR |= 1U << 24;
    while (!(RCC_CR & 1U << 25)) {
    }
    RCC_CFGR |= 2;
    while ((RCC_CFGR & 0xC) != 8) {
    }
    results[6] = RCC_CFGR;
    DEMCR |= 1U << 24;
    DWT_CYCCNT = 0;
    DWT_CTRL |= 1;
    uint32_t before = DWT_CYCCNT;
    for (uint32_t i = 0; i < 1000; i++) {
        __asm volatile("nop\nnop\n");
    }
    results[7] = DWT_CYCCNT - before;
    results[8] = 1;
    return 0;
}
