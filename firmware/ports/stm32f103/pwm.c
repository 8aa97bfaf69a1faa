/* Pulses to speed controllers, counted in half-microseconds (RM0008 15.3.9, 15.4): two by TIM4 (PB6, PB7) in
 * the pin set standard, four by TIM2 (PA0 to PA3) in the pin set quadrotor. In the pin set wheels both timers
 * count the wheels, and none of their registers is written here.
 *
 * The compare registers and the frame length are preloaded, so that a change takes effect between two pulses.
 * Update disable (UDIS) is set while all compare registers are written: all pulses change in the same frame,
 * and a frame that ends in between repeats the old pulses. No other file writes these registers, and every
 * value is clamped here to the range of core/esc.h, so that damaged memory of the caller cannot exceed it.
 *
 * Neutral does not wait for the end of a long frame: the frame that runs is ended as soon as its pulses are
 * over (end_frame()), so a neutral pulse begins at most ESC_FRAME_ENDED_HALFUS after neutral was called for.
 *
 * Which timer gives the pulses is read from the timers themselves, never from memory: SysTick and the fault
 * handler come here, too. In the pin set bridge TIM2 belongs to the Hall sensors. */
#include "pwm.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_guard.h"
#include "bridge.h"
#include "clock.h"
#include "core/esc.h"
#include "generated/used_parts.h"
#include "motors.h"
#include "pins.h"
#include "stall.h"
#include "stm32f103.h"

#define START_FRAME_HALFUS      5000U /* 400 Hz */
#define CONSTANT_NEUTRAL_HALFUS 2000U /* 1 ms: motor off */
#define RUNNING                 (PULSE_CR1_ARPE | PULSE_CR1_CEN)
#define PAIR                    (PULSE_CCER_CC(0) | PULSE_CCER_CC(1))
#define FOUR                    (PAIR | PULSE_CCER_CC(2) | PULSE_CCER_CC(3))
#define PRELOADED_PWM1          (PULSE_CCMR_OCM_PWM1 | PULSE_CCMR_OCPE)
#define BOTH(mode)              ((mode) << 8 | (mode))

#define END_LEAD_HALFUS 40U /* 160 cycles at 8 MHz, more than end_frame() needs to write the end */

BOARD_GUARDED static uint32_t neutral_halfus;

static uint32_t bounded(uint32_t value, uint32_t low, uint32_t high) {
    return value < low ? low : value > high ? high : value;
}

/* TIM2 gives the pulses of four rotors: the Hall sensors need no more than its first channel. */
static bool drives_rotors(void) {
    return USED_ROTORS && PULSE_CCER(TIM2_BASE) == FOUR;
}

/* TIM4 gives pulses, on pins or not, unless it counts a wheel. */
static bool drives_pair(void) {
    return USED_PULSES && !(USED_WHEELS && ENCODER_SMCR(TIM4_BASE) != 0U);
}

/* Always leaves UDIS clear, even when it interrupted another write_pulses(). */
static void write_pulses(uint32_t timer, const uint32_t pulse[], uint32_t count) {
    PULSE_CR1(timer) = RUNNING | PULSE_CR1_UDIS;
    for (uint32_t i = 0U; i < count; i++) {
        PULSE_CCR(timer, i) = pulse[i];
    }
    PULSE_CR1(timer) = RUNNING;
}

/* Ends the frame that runs once its pulses and a gap are over; the next one has its usual length. No pulse
 * becomes shorter or longer: the counter is left alone, only the frame's end comes nearer. Without preload a
 * new length takes effect at once, and the counter must not be past it: it would run on to 65535.
 * Call it with interrupts masked. */
static void end_frame(uint32_t timer) {
    const uint32_t usual = PULSE_ARR(timer);
    const uint32_t soonest = PULSE_CNT(timer) + END_LEAD_HALFUS;
    const uint32_t end = (soonest > ESC_FRAME_ENDED_HALFUS ? soonest : ESC_FRAME_ENDED_HALFUS) - 1U;
    if (end < usual) {
        PULSE_ARR(timer) = end; /* what is preloaded may take effect when the preload is switched off */
        PULSE_CR1(timer) = PULSE_CR1_CEN;
        PULSE_ARR(timer) = end;
        PULSE_CR1(timer) = RUNNING;
        PULSE_ARR(timer) = usual;
    }
}

/* All pulses of a timer at neutral, soon. Call it with interrupts masked. SysTick comes here every
 * millisecond while the loop stalls: the frame is ended once. */
static void rest(uint32_t timer, uint32_t count, uint32_t pulse) {
    const uint32_t all[BOARD_ROTORS] = {pulse, pulse, pulse, pulse};
    bool drives = false;
    for (uint32_t i = 0U; i < count; i++) {
        drives = drives || PULSE_CCR(timer, i) != pulse;
    }
    write_pulses(timer, all, count);
    if (drives) {
        end_frame(timer);
    }
}

static void rest_all(uint32_t pulse) {
    if (drives_pair()) {
        rest(TIM4_BASE, BOARD_ACTUATORS, pulse);
    }
    if (drives_rotors()) {
        rest(TIM2_BASE, BOARD_ROTORS, pulse);
    }
}

static void set_up(uint32_t timer, uint32_t outputs) {
    PULSE_PSC(timer) = clock_mhz() / 2U - 1U;
    PULSE_CCMR1(timer) = BOTH(PRELOADED_PWM1);
    if (outputs == FOUR) {
        PULSE_CCMR2(timer) = BOTH(PRELOADED_PWM1);
    }
    PULSE_CCER(timer) = outputs;
}

static void begin(uint32_t timer) {
    PULSE_EGR(timer) = PULSE_EGR_UG;
}

void pwm_init(uint32_t pins) {
    RCC_APB1ENR |= (USED_PULSES ? RCC_APB1ENR_TIM4EN : 0U) | (USED_ROTORS ? RCC_APB1ENR_TIM2EN : 0U);
    const bool pair = drives_pair();
    if (pair) { /* else the pin of channel 1 may belong to the UART */
        set_up(TIM4_BASE, pins == BOARD_PINS_STANDARD ? PAIR : 0U);
    }
    if (board_pins_rotors(pins)) {
        set_up(TIM2_BASE, FOUR);
    }
    board_configure_actuator(START_FRAME_HALFUS, CONSTANT_NEUTRAL_HALFUS);
    if (pair) {
        begin(TIM4_BASE);
    }
    if (drives_rotors()) {
        begin(TIM2_BASE);
    }
}

void board_configure_actuator(uint32_t frame_halfus, uint32_t wanted_neutral_halfus) {
    neutral_halfus = wanted_neutral_halfus;
    board_actuator_neutral(); /* first, because the pulses in use might not fit into a shorter frame */
    const uint32_t last = bounded(frame_halfus, ESC_FRAME_MIN_HALFUS, ESC_FRAME_MAX_HALFUS) - 1U;
    if (drives_pair()) {
        PULSE_ARR(TIM4_BASE) = last;
    }
    if (drives_rotors()) {
        PULSE_ARR(TIM2_BASE) = last;
    }
}

static void set_pulses(uint32_t timer, const uint32_t pulse_halfus[], uint32_t count) {
    const uint32_t fits = PULSE_ARR(timer) + 1U - ESC_GAP_MIN_HALFUS;
    const uint32_t high = fits < ESC_PULSE_MAX_HALFUS ? fits : ESC_PULSE_MAX_HALFUS;
    uint32_t pulse[BOARD_ROTORS];
    for (uint32_t i = 0U; i < count; i++) {
        pulse[i] = bounded(pulse_halfus[i], ESC_PULSE_MIN_HALFUS, high);
    }
    /* Interrupts off: else SysTick could write neutral after the check, and this write would undo it. */
    __asm volatile("cpsid i" ::: "memory");
    if (!stall_latched()) {
        write_pulses(timer, pulse, count);
    }
    __asm volatile("cpsie i" ::: "memory");
}

void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]) {
    if (drives_pair()) {
        set_pulses(TIM4_BASE, pulse_halfus, BOARD_ACTUATORS);
    }
}

void board_set_rotors(const uint32_t pulse_halfus[BOARD_ROTORS]) {
    if (drives_rotors()) {
        set_pulses(TIM2_BASE, pulse_halfus, BOARD_ROTORS);
    }
}

void board_arm_actuator(void) {
    stall_watch(true);
    bridge_arm();
    motors_arm();
}

void board_actuator_neutral(void) {
    /* A neutral pulse outside its bounds comes from an old table or damaged memory: use the constant. */
    const uint32_t kept = neutral_halfus;
    const bool good = kept >= ESC_PULSE_MIN_HALFUS && kept <= ESC_OFF_MAX_HALFUS;
    uint32_t masked;
    /* Interrupts off: else SysTick could find the length that end_frame() is about to undo. */
    __asm volatile("mrs %0, primask \n cpsid i" : "=r"(masked)::"memory");
    rest_all(good ? kept : CONSTANT_NEUTRAL_HALFUS);
    motors_off();
    __asm volatile("msr primask, %0" ::"r"(masked) : "memory");
    bridge_off();
    stall_watch(false);
}

static bool turns(uint32_t timer, uint32_t count) {
    bool drives = false;
    for (uint32_t i = 0U; i < count; i++) {
        drives = drives || PULSE_CCR(timer, i) > ESC_OFF_MAX_HALFUS;
    }
    return drives;
}

/* The pulses by their bound, not by neutral_halfus, which changes before the registers do. */
bool pwm_astray(void) {
    return !stall_watches() &&
           ((drives_pair() && turns(TIM4_BASE, BOARD_ACTUATORS)) ||
            (drives_rotors() && turns(TIM2_BASE, BOARD_ROTORS)) || motors_on() || bridge_on());
}

void board_clear_actuator_faults(void) {
    bridge_clear_faults();
    motors_clear_faults();
    stall_clear();
}

/* The pins of four rotors become outputs that are low, before anything else: after a failure of the crystal
 * the timer counts nine times slower, and the pulse that is on its way would last nine times as long. A pulse
 * that ends early is no command. */
void pwm_crash(void) {
    motors_off();
    if (drives_rotors()) {
        pins_rotors_low();
    } else if (drives_pair()) {
        rest(TIM4_BASE, BOARD_ACTUATORS, CONSTANT_NEUTRAL_HALFUS);
    }
    bridge_off();
}
