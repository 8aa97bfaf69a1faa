/* Faults by request in results[0]; the handler notes what the core says and returns past the instruction. */
#include "part.h"
RESULTS;

static void note(uint32_t which, uint32_t *frame) {
    results[2] = which;
    results[3] = frame[6];
    results[4] = SCB_CFSR;
    results[5] = SCB_HFSR;
    results[6] = SCB_BFAR;
    SCB_CFSR = 0xFFFFFFFFU;
    SCB_HFSR = 0xFFFFFFFFU;
    uint16_t first = *(volatile uint16_t *)frame[6];
    frame[6] += first >> 11 >= 29 ? 4 : 2;
}

#define FAULT_HANDLER(name, number)                                                                          \
    void name##_body(uint32_t *frame);                                                                       \
    void name##_body(uint32_t *frame) {                                                                      \
        note(number, frame);                                                                                 \
    }                                                                                                        \
    __attribute__((naked)) void name(void);                                                                  \
    __attribute__((naked)) void name(void) {                                                                 \
        __asm volatile("mrs r0, msp\n b " #name "_body\n");                                                  \
    }

FAULT_HANDLER(hard_fault_handler, 3)
FAULT_HANDLER(bus_fault_handler, 5)
FAULT_HANDLER(usage_fault_handler, 6)

void svcall_handler(void);
__attribute__((naked)) void svcall_handler(void) {
    __asm volatile("mvn lr, #14\n bx lr\n"); /* as if a handler had been interrupted */
}

int main(void) {
    results[1] = 0;
    if (results[7]) {
        SCB_SHCSR = 7U << 16;
    }
    switch (results[0]) {
    case 1:
        (void)REG(0x60000000);
        break;
    case 2:
        REG(0x08000000) = 0;
        break;
    case 3:
        __asm volatile("udf #1");
        break;
    case 4:
        REG(0x40005800) = 1; /* I2C1: not modelled */
        break;
    case 5:
        REG(0x40012408) = 1; /* ADC1 without its clock */
        results[8] = REG(0x40012408);
        break;
    case 6:
        AFIO_MAPR |= 4; /* clock off, too */
        RCC_APB2ENR = 1;
        AFIO_MAPR |= 4; /* read-modify-write of write-only bits */
        AFIO_MAPR |= 4;
        break;
    case 7:
        RCC_CFGR = 7U << 18 | 1U << 16 | 4U << 8;
        RCC_CR |= 1U << 16;
        while (!(RCC_CR & 1U << 17)) {
        }
        RCC_CR |= 1U << 24;
        while (!(RCC_CR & 1U << 25)) {
        }
        RCC_CFGR |= 2; /* 72 MHz without wait states */
        break;
    case 8:
        __asm volatile("mov sp, %0\n udf #2\n" ::"r"(0x1000U));
        break;
    case 9:
        __asm volatile("svc 0");
        break;
    case 10:
        __asm volatile("bx %0" ::"r"(0x08000100U));
        break;
    case 11:
        __asm volatile("bkpt #1");
        break;
    case 12:
        __asm volatile("mcr p14, 0, r0, c0, c0, 0");
        break;
    default:
        break;
    }
    results[1] = 1;
    return 0;
}
