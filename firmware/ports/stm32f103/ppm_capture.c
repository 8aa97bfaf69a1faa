/* Edges of the receiver's pulse train: TIM1 captures its count of 1 us at each rising edge of PA8
 * (RM0008 14.3.6, 14.4), so no latency of an interrupt is in it. The filter wants a level for 8 samples
 * at 1.125 MHz: shorter pulses than 7 us are no edges, and of noise at most one in 14 us. An edge that finds
 * the last one not fetched replaces it; the frame then has too few. */
#include "app/board_receiver.h"
#include "clock.h"
#include "nvic.h"
#include "receiver_lines.h"
#include "stm32f103.h"

#define EDGES 32U /* a power of two; two frames have 18 */

static uint16_t edges_ring[EDGES];
/* Free-running counts, used modulo EDGES: written by the interrupt, read by the loop. */
static volatile uint32_t edges_written, edges_taken;

void ppm_capture_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_TIM1EN;
    nvic_enable(IRQ_TIM1_CC);
    TIM1_PSC = clock_mhz() - 1U;
    TIM1_EGR = TIM1_EGR_UG; /* loads the prescaler */
    TIM1_CCMR1 = TIM1_CCMR1_CC1S_TI1 | TIM1_CCMR1_IC1F_SLOWEST;
    TIM1_CCER = TIM1_CCER_CC1E;
    TIM1_DIER = TIM1_DIER_CC1IE;
    TIM1_CR1 = TIM1_CR1_CKD_DIV2 | TIM1_CR1_CEN;
}

void ppm_capture_handler(void) {
    const uint16_t stamp_us = (uint16_t)TIM1_CCR1; /* takes the request back */
    const uint32_t to = edges_written;
    if (to - edges_taken < EDGES) {
        edges_ring[to % EDGES] = stamp_us;
        memory_fence();
        edges_written = to + 1U;
    }
}

size_t board_receiver_edges(uint16_t *stamps_us, size_t room) {
    const uint32_t end = edges_written;
    memory_fence(); /* the stamps are read after the count */
    uint32_t at = edges_taken;
    size_t count = 0U;
    while (count < room && at != end) {
        stamps_us[count++] = edges_ring[at++ % EDGES];
    }
    memory_fence();
    edges_taken = at;
    return count;
}
