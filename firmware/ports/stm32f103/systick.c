/* Time from SysTick: it interrupts every millisecond and counts on while the processor sleeps.
 *
 * The cycle counter (DWT_CYCCNT) stands still in WFI sleep unless a debugger keeps the clock running, so it
 * cannot tell the time of a loop that sleeps. */
#include "systick.h"
#include "app/board.h"
#include "clock.h"
#include "guard.h"
#include "idle.h"
#include "nvic.h"
#include "stm32f103.h"

#define BACK_MAX_US 2000u /* behind the last look, by less than a tick: see board_now_us() */

static volatile uint32_t ticks_ms;
static uint32_t last_us;

void systick_init(void) {
    SCB_SHPR3 = NVIC_PRIORITY << 16; /* PendSV; SysTick, the byte above, stays 0: the highest */
    SYST_RVR = clock_mhz() * 1000u - 1u;
    SYST_CVR = 0u;
    SYST_CSR = SYST_CSR_ENABLE | SYST_CSR_TICKINT | SYST_CSR_CLKSOURCE;
}

void systick_count(void) {
    ticks_ms++;
    idle_end();
}

uint32_t systick_ms(void) {
    return ticks_ms;
}

uint32_t board_now_us(void) {
    uint32_t ms = ticks_ms;
    uint32_t left = SYST_CVR;
    if (ticks_ms != ms) { /* the tick came in between: cannot happen twice within a millisecond */
        ms = ticks_ms;
        left = SYST_CVR;
    }
    const uint32_t rate_mhz = clock_mhz();
    const uint32_t now_us = ms * 1000u + (rate_mhz * 1000u - 1u - left) / rate_mhz;
    /* The counter reloads a few cycles before its interrupt is taken; what was read then lies 1 ms in the
     * past. What lies further back is a flipped bit, in a word that the check over memory leaves out because
     * an interrupt writes it: a clock that waited for it would keep every silence limit from ending. */
    if ((int32_t)(now_us - last_us) > 0) {
        last_us = now_us;
    } else if (last_us - now_us > BACK_MAX_US) {
        last_us = now_us;
        guard_clock_upset();
    }
    return last_us;
}
