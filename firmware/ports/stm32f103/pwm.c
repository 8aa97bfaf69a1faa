/* Pulses to two speed controllers: TIM4 channels 1 and 2 count half-microseconds (RM0008 15.3.9, 15.4).
 *
 * The compare registers and the frame length are preloaded, so that a change takes effect between two pulses.
 * Update disable (UDIS) is set while both compare registers are written: both pulses change in the same
 * frame, and a frame that ends in between repeats the old pulses. No other file writes these registers, and
 * every value is clamped here to the range of core/esc.h, so that damaged memory of the caller cannot exceed
 * it.
 *
 * Neutral does not wait for the end of a long frame: the frame that runs is ended as soon as its pulses are
 * over (end_frame()), so a neutral pulse begins at most ESC_FRAME_ENDED_HALFUS after neutral was called for.
 */
#include "pwm.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_guard.h"
#include "bridge.h"
#include "clock.h"
#include "core/esc.h"
#include "generated/used_parts.h"
#include "stall.h"
#include "stm32f103.h"

#define START_FRAME_HALFUS      5000u /* 400 Hz */
#define CONSTANT_NEUTRAL_HALFUS 2000u /* 1 ms: motor off */
#define RUNNING                 (TIM4_CR1_ARPE | TIM4_CR1_CEN)

#define END_LEAD_HALFUS 40u /* 160 cycles at 8 MHz, more than end_frame() needs to write the end */

BOARD_GUARDED static uint32_t neutral_halfus;

static uint32_t bounded(uint32_t value, uint32_t low, uint32_t high) {
    return value < low ? low : value > high ? high : value;
}

/* Always leaves UDIS clear, even when it interrupted another write_pair(). */
static void write_pair(uint32_t first, uint32_t second) {
    if (!USED_PULSES) {
        return;
    }
    TIM4_CR1 = RUNNING | TIM4_CR1_UDIS;
    TIM4_CCR1 = first;
    TIM4_CCR2 = second;
    TIM4_CR1 = RUNNING;
}

/* Ends the frame that runs once both pulses and a gap are over; the next one has its usual length. No pulse
 * becomes shorter or longer: the counter is left alone, only the frame's end comes nearer. Without preload a
 * new length takes effect at once, and the counter must not be past it: it would run on to 65535.
 * Call it with interrupts masked. */
static void end_frame(void) {
    const uint32_t usual = TIM4_ARR;
    const uint32_t soonest = TIM4_CNT + END_LEAD_HALFUS;
    const uint32_t end = (soonest > ESC_FRAME_ENDED_HALFUS ? soonest : ESC_FRAME_ENDED_HALFUS) - 1u;
    if (end < usual) {
        TIM4_ARR = end; /* what is preloaded may take effect when the preload is switched off */
        TIM4_CR1 = TIM4_CR1_CEN;
        TIM4_ARR = end;
        TIM4_CR1 = RUNNING;
        TIM4_ARR = usual;
    }
}

void pwm_init(uint32_t pins) {
    if (!USED_PULSES) {
        return;
    }
    RCC_APB1ENR |= RCC_APB1ENR_TIM4EN;
    TIM4_PSC = clock_mhz() / 2u - 1u;
    TIM4_CCMR1 = TIM4_CCMR1_OC1M_PWM1 | TIM4_CCMR1_OC1PE | TIM4_CCMR1_OC2M_PWM1 | TIM4_CCMR1_OC2PE;
    board_configure_actuator(START_FRAME_HALFUS, CONSTANT_NEUTRAL_HALFUS);
    TIM4_EGR = TIM4_EGR_UG;
    if (pins == BOARD_PINS_STANDARD) { /* else the pin of channel 1 belongs to the UART */
        TIM4_CCER = TIM4_CCER_CC1E | TIM4_CCER_CC2E;
    }
}

void board_configure_actuator(uint32_t frame_halfus, uint32_t wanted_neutral_halfus) {
    neutral_halfus = wanted_neutral_halfus;
    board_actuator_neutral(); /* first, because the pulses in use might not fit into a shorter frame */
    if (!USED_PULSES) {
        return;
    }
    TIM4_ARR = bounded(frame_halfus, ESC_FRAME_MIN_HALFUS, ESC_FRAME_MAX_HALFUS) - 1u;
}

void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]) {
    const uint32_t fits = TIM4_ARR + 1u - ESC_GAP_MIN_HALFUS;
    const uint32_t high = fits < ESC_PULSE_MAX_HALFUS ? fits : ESC_PULSE_MAX_HALFUS;
    const uint32_t first = bounded(pulse_halfus[0], ESC_PULSE_MIN_HALFUS, high);
    const uint32_t second = bounded(pulse_halfus[1], ESC_PULSE_MIN_HALFUS, high);
    /* Interrupts off: else SysTick could write neutral after the check, and this write would undo it. */
    __asm volatile("cpsid i" ::: "memory");
    if (!stall_latched()) {
        write_pair(first, second);
    }
    __asm volatile("cpsie i" ::: "memory");
}

void board_arm_actuator(void) {
    stall_watch(true);
    bridge_arm();
}

void board_actuator_neutral(void) {
    /* A neutral pulse outside its bounds comes from an old table or damaged memory: use the constant. */
    const uint32_t kept = neutral_halfus;
    const bool good = kept >= ESC_PULSE_MIN_HALFUS && kept <= ESC_OFF_MAX_HALFUS;
    const uint32_t pulse = good ? kept : CONSTANT_NEUTRAL_HALFUS;
    uint32_t masked;
    /* Interrupts off: else SysTick could find the length that end_frame() is about to undo. SysTick comes
     * here, too, every millisecond while the loop stalls: the frame is ended once. */
    __asm volatile("mrs %0, primask \n cpsid i" : "=r"(masked)::"memory");
    const bool drives = USED_PULSES && (TIM4_CCR1 != pulse || TIM4_CCR2 != pulse);
    write_pair(pulse, pulse);
    if (drives) {
        end_frame();
    }
    __asm volatile("msr primask, %0" ::"r"(masked) : "memory");
    bridge_off();
    stall_watch(false);
}

void board_clear_actuator_faults(void) {
    bridge_clear_faults();
    stall_clear();
}

void pwm_crash(void) {
    if (USED_PULSES) {
        write_pair(CONSTANT_NEUTRAL_HALFUS, CONSTANT_NEUTRAL_HALFUS);
        end_frame();
    }
    bridge_off();
}
