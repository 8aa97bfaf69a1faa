/* Three-phase bridge on TIM1, commutated by the rotor's Hall sensors on TIM2; only with BOARD_PINS_BRIDGE
 * (RM0008 14.3.11 to 14.3.18, 15.3.5; docs/explanation/motor-bridge.md).
 *
 * Every commutation is one interrupt: a Hall edge raises it, and a new duty pends it. It writes preloaded
 * registers, and one COM event changes all six switches at once. A floating phase keeps its high side enabled
 * but forced low, so that with OSSR and OSSI the timer drives every gate low whatever happens. All three
 * phases float like this from bridge_init() on, before the pins become outputs of the timer; until then the
 * gates' pull-down resistors hold them low.
 *
 * The break input (PB12) and the clock security system clear MOE in hardware: no instruction takes part, and
 * none can prevent it (LOCK). Only arming sets MOE again (AOE stays off). */
#include "bridge.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_guard.h"
#include "clock.h"
#include "core/commutation.h"
#include "nvic.h"
#include "stall.h"
#include "stm32f103.h"

#define PWM_HZ 20000U
#define LOW_MIN_NS                                                                                           \
    1000U /* low side on, in every period: fills the bootstrap capacitors of the high sides                  \
           */
#define DTG_SINGLE_MAX   127U /* dead times up to here are counted in single steps, RM0008 14.4.18 */
#define DTG_DOUBLE_MAX   254U
#define OUTPUTS_OF_PHASE (TIM1_CCER_CC1E | TIM1_CCER_CC1NE)
#define OUTPUTS_FLOATING TIM1_CCER_CC1E
#define MODE_LOW         (TIM1_CCMR1_OC1PE | TIM1_CCMR1_OC1M_LOW)

BOARD_GUARDED static bool wired;
BOARD_GUARDED static uint32_t period; /* counts from valley to peak */
BOARD_GUARDED static uint32_t on_max;
BOARD_GUARDED static uint32_t dead_cycles;
BOARD_GUARDED static volatile int32_t wanted_q15; /* written by the loop */
static volatile bool hall_failed;
static uint32_t hall_last;
static volatile uint32_t hall_edges;
static uint32_t changed_at; /* SysTick at the last COM event */

static uint32_t hall_now(void) {
    return (GPIOA_IDR >> 15 & 1U) | (GPIOB_IDR >> 3 & 1U) << 1 | (GPIOB_IDR >> 10 & 1U) << 2;
}

/* The timer inserts the dead time between low side off and high side on only while both outputs of a phase
 * are enabled. A phase that floats in between is not covered, so two COM events are kept at least a dead time
 * apart. */
static void wait_dead_time(void) {
    const uint32_t reload = clock_mhz() * 1000U;
    for (uint32_t polls = dead_cycles; polls > 0U; polls--) {
        if ((changed_at + reload - SYST_CVR) % reload >= dead_cycles) {
            break;
        }
    }
    changed_at = SYST_CVR;
}

/* Preloads the output modes (8 bits a phase) and enables (4 bits a phase); the COM event activates them. */
static void preload(uint32_t modes, uint32_t outputs) {
    TIM1_CCMR1 = modes & 0xffffU;
    TIM1_CCMR2 = modes >> 16;
    TIM1_CCER = outputs;
}

/* Hall edge, or a new duty. */
void bridge_handler(void) {
    TIM2_SR = ~TIM2_SR_CC1IF;
    const uint32_t hall = hall_now();
    hall_edges += (uint32_t)commutation_moved(hall_last, hall);
    hall_last = hall;

    commutation_t c;
    if (!commutation_step(&c, hall, wanted_q15, period, on_max)) {
        hall_failed = true;
    }
    if (hall_failed) { /* stays so until the next run */
        TIM1_BDTR &= ~TIM1_BDTR_MOE;
        c = (commutation_t){.on = 0U};
    }
    uint32_t modes = 0U, outputs = 0U;
    for (uint32_t phase = 0U; phase < COMMUTATION_PHASES; phase++) {
        const uint32_t mode = c.drive[phase] == COMMUTATION_PWM ? TIM1_CCMR1_OC1M_PWM1 : TIM1_CCMR1_OC1M_LOW;
        modes |= (TIM1_CCMR1_OC1PE | mode) << 8U * phase;
        outputs |= (c.drive[phase] == COMMUTATION_FLOAT ? OUTPUTS_FLOATING : OUTPUTS_OF_PHASE) << 4U * phase;
    }
    TIM1_CCR1 = c.on;
    TIM1_CCR2 = c.on;
    TIM1_CCR3 = c.on;
    preload(modes, outputs);
    wait_dead_time();
    TIM1_EGR = TIM1_EGR_COMG;
}

static void commutate(void) {
    NVIC_ISPR(IRQ_TIM2 / 32U) = 1U << IRQ_TIM2 % 32U;
}

void bridge_init(uint32_t dead_time_ns) {
    const uint32_t mhz = clock_mhz();
    const uint32_t dead = (dead_time_ns * mhz + 999U) / 1000U;
    dead_cycles = dead < DTG_DOUBLE_MAX ? dead : DTG_DOUBLE_MAX;
    period = mhz * 1000000U / PWM_HZ / 2U;
    on_max = period - dead_cycles - LOW_MIN_NS * mhz / 2000U;

    RCC_APB2ENR |= RCC_APB2ENR_TIM1EN;
    TIM1_CR2 = TIM1_CR2_CCPC;
    TIM1_PSC = 0U;
    TIM1_ARR = period;
    const uint32_t coded =
        dead_cycles <= DTG_SINGLE_MAX ? dead_cycles : TIM1_BDTR_DTG_DOUBLE | ((dead_cycles + 1U) / 2U - 64U);
    /* Break input active low and pulled down: an open wire trips it. */
    TIM1_BDTR = coded | TIM1_BDTR_OSSI | TIM1_BDTR_OSSR | TIM1_BDTR_BKE | TIM1_BDTR_LOCK_LEVEL2;
    preload(MODE_LOW << 16 | MODE_LOW << 8 | MODE_LOW,
            OUTPUTS_FLOATING << 8 | OUTPUTS_FLOATING << 4 | OUTPUTS_FLOATING);
    TIM1_EGR = TIM1_EGR_UG | TIM1_EGR_COMG;
    TIM1_CR1 = TIM1_CR1_ARPE | TIM1_CR1_CMS_MODE1 | TIM1_CR1_CEN;
}

void bridge_start(void) {
    /* Any edge of the three inputs captures, after 14 us of quiet (at 72 MHz): longer than the PWM rings. */
    RCC_APB1ENR |= RCC_APB1ENR_TIM2EN;
    TIM2_CR2 = TIM2_CR2_TI1S;
    TIM2_SMCR = TIM2_SMCR_TS_TI1F_ED;
    TIM2_CCMR1 = TIM2_CCMR1_CC1S_TRC | TIM2_CCMR1_IC1F_8_DIV32;
    TIM2_CCER = TIM2_CCER_CC1E;
    TIM2_DIER = TIM2_DIER_CC1IE;
    TIM2_CR1 = TIM2_CR1_CKD_DIV4 | TIM2_CR1_CEN;
    hall_last = hall_now();
    nvic_enable(IRQ_TIM2);
    wired = true;
    bridge_clear_faults(); /* of inputs that floated before their pull resistors were on */
}

void bridge_arm(void) {
    if (wired) {
        wanted_q15 = 0;
        commutate();
        /* Interrupts off: else SysTick could clear MOE between load and store, and the store would undo it.
         */
        __asm volatile("cpsid i" ::: "memory");
        if (!hall_failed && !stall_latched()) {
            TIM1_BDTR |= TIM1_BDTR_MOE;
        }
        __asm volatile("cpsie i" ::: "memory");
    }
}

void board_set_bridge(int32_t duty_q15) {
    if (wired) {
        wanted_q15 = duty_q15;
        commutate();
    }
}

int16_t bridge_hall_count(void) {
    return (int16_t)(uint16_t)hall_edges;
}

bool bridge_on(void) {
    return (RCC_APB2ENR & RCC_APB2ENR_TIM1EN) != 0U && (TIM1_BDTR & TIM1_BDTR_MOE) != 0U;
}

/* Reads no memory: the fault handler calls it, too. */
void bridge_off(void) {
    if (bridge_on()) {
        TIM1_BDTR &= ~TIM1_BDTR_MOE;
    }
}

void bridge_clear_faults(void) {
    if (wired) {
        TIM1_SR = ~TIM1_SR_BIF; /* stays set while the input is active */
        hall_failed = false;
        commutate(); /* sets hall_failed again when the Hall state is still invalid */
    }
}

uint32_t bridge_faults(void) {
    if (!wired) {
        return 0U;
    }
    return ((TIM1_SR & TIM1_SR_BIF) != 0U ? BOARD_FAULT_BRIDGE : 0U) | (hall_failed ? BOARD_FAULT_HALL : 0U);
}
