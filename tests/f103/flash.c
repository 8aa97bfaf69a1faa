/* Carries out what the test asks for in results[8..]: pairs of (kind or register, value); after each it notes
 * FLASH_SR in results[32..] and the processor cycles it took in results[48..]. results[1]: how many are done.
 */
#include "part.h"
RESULTS;

#define FLASH_REGISTERS 0x40022000U
#define TARGET          0x0800F000U

void hard_fault_handler(void);
void hard_fault_handler(void) {
    results[2] = results[1] + 1U; /* which one, counted from 1 */
    for (;;) {
    }
}

int main(void) {
    DEMCR = 1U << 24;
    DWT_CTRL = 1;
    results[1] = results[2] = 0;
    for (uint32_t i = 0; i < results[0]; i++) {
        const uint32_t what = results[8 + 2 * i], value = results[9 + 2 * i];
        const uint32_t from = DWT_CYCCNT;
        if (what < 0x100U) {
            REG(FLASH_REGISTERS + what) = value;
        } else if (what == 0x200U) { /* half-word, at the place in the upper half of the value */
            *(volatile uint16_t *)(TARGET + (value >> 16)) = (uint16_t)value;
        } else {
            REG(TARGET) = value;
        }
        results[48 + i] = DWT_CYCCNT - from;
        results[32 + i] = REG(FLASH_REGISTERS + 0x0CU);
        results[1] = i + 1U;
    }
    for (;;) {
        wait_for_interrupt();
    }
}
