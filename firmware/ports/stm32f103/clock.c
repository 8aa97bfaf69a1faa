/* 72 MHz from an 8 MHz crystal, or 64 MHz from the internal oscillator when there is no crystal
 * (RM0008 7.2, 7.3). */
#include "clock.h"
#include "app/board_guard.h"
#include "stm32f103.h"

/* Each bound is the datasheet's worst case, generously rounded up, at the frequency the processor has then.
 */
#define POLL_CYCLES      64U
#define POLLS(us, mhz)   (((us) * (mhz)) / POLL_CYCLES)
#define CRYSTAL_POLLS    POLLS(100000U, 8U) /* typically 2 ms, slow crystals some 10 ms */
#define OSCILLATOR_POLLS POLLS(1000U, 8U)   /* HSI starts within 2 us */
#define PLL_POLLS        POLLS(1000U, 8U)   /* locks within 200 us */
#define SWITCH_POLLS     POLLS(100U, 72U)   /* a few cycles of either clock */

BOARD_GUARDED static uint32_t mhz;

bool clock_wait(volatile const uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls) {
    for (; polls > 0U; polls--) {
        if ((*address & mask) == value) {
            return true;
        }
        /* Subtract and taken branch: at least 4 cycles a turn. */
        uint32_t turns = POLL_CYCLES / 4U;
        __asm volatile("1: subs %0, %0, #1 \n bne 1b" : "+r"(turns)::"cc");
    }
    return false;
}

/* Multiplies `source` up and switches over; false leaves the processor on the internal oscillator. */
static bool run_from_pll(uint32_t source) {
    /* APB1 is limited to 36 MHz, the ADC to 14 MHz (RM0008 7.3.2): half, and a sixth. */
    RCC_CFGR = source | RCC_CFGR_PPRE1_DIV2 | RCC_CFGR_ADCPRE_DIV6;
    RCC_CR |= RCC_CR_PLLON;
    if (!clock_wait(&RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, PLL_POLLS)) {
        return false;
    }
    RCC_CFGR |= RCC_CFGR_SW_PLL;
    return clock_wait(&RCC_CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, SWITCH_POLLS);
}

bool clock_init(bool try_crystal) {
    /* A ROM bootloader that jumped here has left its own PLL running: back to the state after reset first. */
    RCC_CR |= RCC_CR_HSION;
    (void)clock_wait(&RCC_CR, RCC_CR_HSIRDY, RCC_CR_HSIRDY, OSCILLATOR_POLLS);
    RCC_CFGR &= ~RCC_CFGR_SW; /* nothing else of it may change while the PLL runs */
    (void)clock_wait(&RCC_CFGR, RCC_CFGR_SWS, 0U, SWITCH_POLLS);
    RCC_CR &= ~(RCC_CR_PLLON | RCC_CR_HSEON | RCC_CR_CSSON);

    /* Two wait states above 48 MHz, prefetch on, before the clock rises (RM0008 3.3.3). */
    FLASH_ACR = FLASH_ACR_PRFTBE | FLASH_ACR_LATENCY_WS2;

    if (try_crystal) {
        RCC_CR |= RCC_CR_HSEON;
    }
    if (try_crystal && clock_wait(&RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY, CRYSTAL_POLLS) &&
        run_from_pll(RCC_CFGR_PLLSRC | RCC_CFGR_PLLMUL_X9)) {
        /* When the crystal fails from here on, the clock becomes 8 MHz internal and NMI is raised (RM0008
         * 7.2.7). */
        RCC_CR |= RCC_CR_CSSON;
        mhz = 72U;
        return true;
    }
    RCC_CFGR = 0U;
    RCC_CR &= ~(RCC_CR_PLLON | RCC_CR_HSEON);
    (void)clock_wait(&RCC_CR, RCC_CR_PLLRDY, 0U, PLL_POLLS); /* PLLMUL is locked while the PLL runs */
    mhz = run_from_pll(RCC_CFGR_PLLMUL_X16) ? 64U : 8U;
    if (mhz == 8U) {
        RCC_CFGR = 0U;
    }
    return false;
}

uint32_t clock_mhz(void) {
    return mhz;
}

uint32_t clock_pclk1_mhz(void) {
    return mhz > 36U ? mhz / 2U : mhz;
}
