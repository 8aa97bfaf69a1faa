/* Start-up of the small programs that try one peripheral each. No initialised data: only .bss is cleared. */
#include "part.h"

extern uint32_t bss_begin[], bss_end[], stack_top[];
int main(void);
static void reset_handler(void) {
    for (uint32_t *word = bss_begin; word < bss_end; word++) {
        *word = 0;
    }
    (void)main();
    for (;;) {
    }
}

static void unexpected(void) {
    for (;;) {
    }
}

#define HANDLER(name) void name(void) __attribute__((weak, alias("unexpected")))
HANDLER(nmi_handler);
HANDLER(hard_fault_handler);
HANDLER(bus_fault_handler);
HANDLER(usage_fault_handler);
HANDLER(svcall_handler);
HANDLER(pendsv_handler);
HANDLER(systick_handler);
HANDLER(irq0_handler);
HANDLER(irq1_handler);
HANDLER(irq2_handler);
HANDLER(irq6_handler);
HANDLER(irq23_handler);
HANDLER(dma1_channel1_handler);
HANDLER(dma1_channel4_handler);
HANDLER(dma1_channel5_handler);
HANDLER(tim2_handler);
HANDLER(usart1_handler);
HANDLER(usart2_handler);
HANDLER(usart3_handler);

typedef void (*vector_t)(void);
__attribute__((section(".vectors"), used)) static const vector_t vectors[16 + 60] = {
    (vector_t)(uintptr_t)stack_top,
    reset_handler,
    nmi_handler,
    hard_fault_handler,
    unexpected,
    bus_fault_handler,
    usage_fault_handler,
    [11] = svcall_handler,
    [14] = pendsv_handler,
    [15] = systick_handler,
    [16] = irq0_handler,
    [17] = irq1_handler,
    [18] = irq2_handler,
    [16 + 6] = irq6_handler,
    [16 + 23] = irq23_handler,
    [16 + 11] = dma1_channel1_handler,
    [16 + 14] = dma1_channel4_handler,
    [16 + 15] = dma1_channel5_handler,
    [16 + 28] = tim2_handler,
    [16 + 37] = usart1_handler,
    [16 + 38] = usart2_handler,
    [16 + 39] = usart3_handler,
};
