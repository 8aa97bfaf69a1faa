/* Feeds the watchdog ten times, 10 ms apart, then no more. Counts boots and keeps the reset flags of each. */
#include "part.h"
RESULTS;

int main(void) {
    if (results[0] != 0xB007U) {
        results[0] = 0xB007U;
        results[1] = 0;
    }
    results[2 + results[1] % 4] = RCC_CSR;
    results[1]++;
    RCC_CSR = 1U << 24;
    if (results[1] == 3) {
        SCB_AIRCR = 0x05FA0004;
        for (;;) {
        }
    }
    IWDG_KR = 0xCCCC;
    IWDG_KR = 0x5555;
    IWDG_PR = 1;    /* 40 kHz / 8 */
    IWDG_RLR = 249; /* 50 ms */
    while (IWDG_SR) {
    }
    IWDG_KR = 0xAAAA;
    SYST_RVR = 80000 - 1; /* 10 ms at 8 MHz */
    SYST_CVR = 0;
    SYST_CSR = 5;
    for (uint32_t fed = 0; fed < 10; fed++) {
        while (!(SYST_CSR & 1U << 16)) {
        }
        IWDG_KR = 0xAAAA;
        results[10] = fed + 1;
    }
    for (;;) {
        wait_for_interrupt();
    }
}
