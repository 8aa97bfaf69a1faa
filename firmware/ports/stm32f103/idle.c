#include "idle.h"
#include "app/board.h"

volatile bool idle_over;
#if USED_ACTUATORS
volatile bool idle_news;
#endif

void board_idle(void) {
    for (;;) {
        /* With interrupts masked, WFI still ends when one is pending, so that no interrupt is missed between
         * the check of idle_over and the sleep. */
        __asm volatile("cpsid i" ::: "memory");
        if (idle_over) {
            idle_over = false;
            __asm volatile("cpsie i" ::: "memory");
            return;
        }
        __asm volatile("wfi \n cpsie i \n isb" ::: "memory");
    }
}
