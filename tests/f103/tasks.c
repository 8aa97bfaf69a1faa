/* Two tasks on process stacks, switched by PendSV at every SysTick and started by SVC, as an RTOS does it. */
#include "part.h"
RESULTS;

enum { STACK_WORDS = 64, TICK_CYCLES = 8000 };
static uint32_t stacks[2][STACK_WORDS];
__attribute__((used)) static uint32_t *tops[2];
static volatile uint32_t current;

static uint32_t control(void) {
    uint32_t value;
    __asm volatile("mrs %0, control" : "=r"(value));
    return value;
}

static void task(uint32_t which) {
    register uint32_t kept __asm("r8") = 0xA5A50000U + which;
    for (;;) {
        __asm volatile("" : "+r"(kept));
        results[which] = results[which] + 1;
        results[4 + which] = control();
        if (kept != 0xA5A50000U + which) {
            results[8] = 1;
        }
    }
}

void svcall_handler(void);
__attribute__((naked)) void svcall_handler(void) {
    __asm volatile("ldr r0, =tops\n"
                   "ldr r0, [r0]\n"
                   "ldmia r0!, {r4-r11}\n"
                   "msr psp, r0\n"
                   "orr lr, #0xd\n"
                   "bx lr\n");
}

__attribute__((used)) static uint32_t *next(uint32_t *top) {
    results[6] = control();
    tops[current] = top;
    current = 1 - current;
    results[7] = results[7] + 1;
    return tops[current];
}

void pendsv_handler(void);
__attribute__((naked)) void pendsv_handler(void) {
    __asm volatile("mrs r0, psp\n"
                   "stmdb r0!, {r4-r11}\n"
                   "push {r3, lr}\n"
                   "bl next\n"
                   "pop {r3, lr}\n"
                   "ldmia r0!, {r4-r11}\n"
                   "msr psp, r0\n"
                   "bx lr\n");
}

void systick_handler(void) {
    SCB_ICSR = 1U << 28;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    for (uint32_t i = 0; i < 2; i++) {
        uint32_t *frame = &stacks[i][STACK_WORDS - 8];
        frame[0] = i;
        frame[6] = (uint32_t)(uintptr_t)task;
        frame[7] = 1U << 24;
        tops[i] = frame - 8;
    }
    SCB_SHPR8(14) = 0xF0;
    SCB_SHPR8(15) = 0xF0;
    SYST_RVR = TICK_CYCLES - 1;
    SYST_CSR = 7;
    __asm volatile("svc 0" ::: "memory");
    results[9] = 1; /* never reached */
    return 0;
}
