/* Clock security: runs from the crystal with CSS on; the non-maskable interrupt notes what is left when it
 * dies. */
#include "part.h"
RESULTS;

void nmi_handler(void) {
    results[0]++;
    results[1] = RCC_CIR;
    results[2] = RCC_CR;
    results[3] = RCC_CFGR;
    RCC_CIR = 1U << 23;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    clock_72mhz();
    RCC_CR |= 1U << 19;
    irq_off(); /* does not keep an NMI out */
    for (;;) {
        results[4]++;
    }
}
