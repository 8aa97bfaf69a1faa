/* Vector table and reset of any Cortex-M; the memory is in link.ld. */
#include "console.h"

extern uint32_t data_load, data_start, data_end, bss_start, bss_end, stack_top; /* link.ld */

int main(void);

void reset_handler(void);

void reset_handler(void) {
    for (uint32_t *from = &data_load, *to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    console_exit(main());
}

static void fault_handler(void) {
    console_exit(2);
}

typedef union {
    uint32_t *stack;
    void (*handler)(void);
} vector_t;

__attribute__((section(".vectors"), used)) static const vector_t vectors[] = {
    {.stack = &stack_top},
    {.handler = reset_handler},
    {.handler = fault_handler}, /* NMI */
    {.handler = fault_handler}, /* hard fault */
};
