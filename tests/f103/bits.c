/* Bit-band accesses to RAM and registers, as the macros of libraries make them. */
#include "part.h"
RESULTS;

#define RAM_BIT(address, bit)  REG(0x22000000U + (((address) - 0x20000000U) * 32U) + (bit) * 4U)
#define REG_BIT(address, bit)  REG(0x42000000U + (((address) - 0x40000000U) * 32U) + (bit) * 4U)
#define RAM_BIT8(address, bit) (*(volatile uint8_t *)&RAM_BIT(address, bit))

static volatile uint32_t word = 0;

int main(void) {
    uint32_t at = (uint32_t)(uintptr_t)&word;
    word = 0x80000001U;
    results[0] = RAM_BIT(at, 31) + 10U * RAM_BIT(at, 30) + 100U * RAM_BIT(at, 0);
    RAM_BIT(at, 7) = 1;
    RAM_BIT(at, 0) = 0xFFFFFFFEU; /* bit 0 of the value counts: 0 */
    RAM_BIT8(at, 20) = 3;
    results[1] = word;
    REG_BIT(0x40021018, 2) = 1;  /* clock of port A */
    REG_BIT(0x40021018, 14) = 1; /* clock of USART1 */
    results[2] = RCC_APB2ENR;
    GPIOA_CRL = 0x44444442U;
    REG_BIT(0x4001080C, 0) = 1; /* GPIOA_ODR */
    results[3] = REG_BIT(0x40010808, 0);
    results[4] = REG(0x22000000U + 32U * 20480U - 4U) <= 1U;
    if (results[8]) {
        results[5] = REG(0x22000000U + 32U * 20480U); /* behind the RAM's last bit */
    }
    if (results[9]) {
        results[5] = REG_BIT(0x40005C00, 0); /* USB is not modelled */
    }
    results[10] = 1;
    return 0;
}
