/* SysTick at 1 kHz, and the loop that must not lose a wake-up: mask, look, sleep, unmask. */
#include "part.h"
RESULTS;
static volatile uint32_t ticks;

void systick_handler(void) {
    ticks++;
    results[0] = ticks;
    results[4] = SYST_CVR;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    clock_72mhz();
    DEMCR |= 1U << 24;
    DWT_CTRL |= 1;
    SYST_RVR = 72000 - 1;
    SYST_CVR = 0;
    SYST_CSR = 7;
    uint32_t seen = 0;
    for (;;) {
        irq_off();
        if (ticks == seen) {
            wait_for_interrupt();
            results[1]++; /* wake-ups, counted before the handler runs */
            results[3] = ticks - seen;
        }
        irq_on();
        results[2] += ticks - seen; /* ticks noticed */
        seen = ticks;
        results[5] = DWT_CYCCNT;
    }
}
