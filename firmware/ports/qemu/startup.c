/* Vector table and reset for QEMU's machines with a Cortex-M: code at 0, RAM at 0x20000000. */
#include "semihosting.h"
#include <string.h>

#define EXIT_FAULT 14U

extern uint32_t _data_load, _data_start, _data_end, _bss_start, _bss_end, _stack_top; /* qemu.ld */

int main(void);
void reset_handler(void);

void reset_handler(void) {
    for (uint32_t *from = &_data_load, *to = &_data_start; to < &_data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &_bss_start; to < &_bss_end;) {
        *to++ = 0;
    }
    semihosting_exit((uint32_t)main());
}

static void fault_handler(void) {
    semihosting_exit(EXIT_FAULT);
}

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector_t;

__attribute__((section(".vectors"), used)) static const vector_t vectors[16] = {
    {.stack = &_stack_top},     {.handler = reset_handler}, {.handler = fault_handler},
    {.handler = fault_handler}, {.handler = fault_handler}, {.handler = fault_handler},
    {.handler = fault_handler},
};
