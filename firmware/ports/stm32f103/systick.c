/* Time from SysTick, which interrupts every millisecond and keeps counting while the processor sleeps.
 *
 * The cycle counter (DWT_CYCCNT) cannot serve: it stops in WFI sleep unless a debugger keeps the clock
 * running.
 */
#include "systick.h"
#include "app/board.h"
#include "clock.h"
#include "guard.h"
#include "idle.h"
#include "nvic.h"
#include "stm32f103.h"

#define BACK_MAX_US 2000U /* a larger step back is damage: see board_now_us() */

static volatile uint32_t ticks_ms;
static uint32_t last_us;

void systick_init(void) {
    SCB_SHPR3 = NVIC_PRIORITY << 16; /* PendSV; SysTick, the byte above, stays 0: the highest */
    SYST_RVR = clock_mhz() * 1000U - 1U;
    SYST_CVR = 0U;
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
    if (ticks_ms != ms) { /* a tick came between the two reads; a second one cannot follow so soon */
        ms = ticks_ms;
        left = SYST_CVR;
    }
    const uint32_t rate_mhz = clock_mhz();
    const uint32_t now_us = ms * 1000U + (rate_mhz * 1000U - 1U - left) / rate_mhz;
    /* The counter reloads a few cycles before its interrupt is taken: a time read in between is 1 ms too
     * early, and the last time is returned instead. A larger step back is a flipped bit in ticks_ms, which
     * has no check word because an interrupt writes it. The clock then goes on from there: if it waited until
     * ticks_ms caught up, no time-out would ever end. */
    if ((int32_t)(now_us - last_us) > 0) {
        last_us = now_us;
    } else if (last_us - now_us > BACK_MAX_US) {
        last_us = now_us;
        guard_clock_upset();
    }
    return last_us;
}
