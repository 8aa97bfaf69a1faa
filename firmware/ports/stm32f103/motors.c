/* The motors of two wheels, behind drivers with a PWM input and two direction inputs (TB6612, VNH5019;
 * docs/explanation/wheel-drivers.md says what each driver does in each state).
 *
 * The PWM is that of TIM1's complementary outputs alone: with CCxE = 0 and CCxNE = 1, OCxN is OCxREF (RM0008
 * table 83), and no dead time takes part. OSSR and OSSI stay 0: each would enable the plain output of such a
 * channel, too, and that of channel 2 is PA9, where USART1 sends. So the timer drives nothing without MOE,
 * and both pins are ordinary outputs, low, but while the motors are on.
 *
 * The break input (PB12) and the clock security system clear MOE in hardware: the pull-down resistors then
 * hold both PWM inputs low, until the loop disarms and drives them and the directions low. Only arming sets
 * MOE.
 *
 * A direction changes at once and the PWM at the end of its half period, so that a motor that turns round
 * gets its old duty the other way for 25 us at most. At duty 0 a direction stays on, so that the driver
 * does what it does in the pauses of the PWM: a TB6612 brakes.
 *
 * Which pin set drives is read from the timer, never from memory: SysTick and the fault handler come here. */
#include "motors.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "clock.h"
#include "core/fixed.h"
#include "stall.h"
#include "stm32f103.h"
#include <stdbool.h>

#define PWM_HZ    20000U
#define BOTH      (TIM1_CCER_CC2NE | TIM1_CCER_CC3NE)
#define PRELOADED (TIM1_CCMR1_OC1PE | TIM1_CCMR1_OC1M_PWM1)
#define UP(pin)   (1U << (pin)) /* in BSRR */
#define DOWN(pin) (1U << (16U + (pin)))
#define FULL_LOG2 15U
#define DUTY_MOST 32767U

/* Of PB14 and PB15: those of the timer while the motors are on. */
static void set_pwm_pins(uint32_t mode) {
    GPIOB_CRH = (GPIOB_CRH & 0x00ffffffU) | mode << 24 | mode << 28;
}

static bool drives(void) {
    return (RCC_APB2ENR & RCC_APB2ENR_TIM1EN) != 0U && TIM1_CCER == BOTH;
}

void motors_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_TIM1EN;
    TIM1_PSC = 0U;
    TIM1_ARR = clock_mhz() * 1000000U / PWM_HZ / 2U;
    TIM1_BDTR = TIM1_BDTR_BKE | TIM1_BDTR_LOCK_LEVEL2;
    TIM1_CCMR1 = PRELOADED << 8; /* channel 2 */
    TIM1_CCMR2 = PRELOADED;      /* channel 3 */
    TIM1_CCR2 = 0U;
    TIM1_CCR3 = 0U;
    TIM1_CCER = BOTH;
    TIM1_EGR = TIM1_EGR_UG;
    TIM1_CR1 = TIM1_CR1_ARPE | TIM1_CR1_CMS_MODE1 | TIM1_CR1_CEN;
    motors_off();
}

static uint32_t counts_of(int32_t duty_q15) {
    const uint32_t size = min_u32(abs_u32(duty_q15), DUTY_MOST);
    return size * TIM1_ARR >> FULL_LOG2;
}

/* Call it with interrupts masked. */
static void write(const int32_t duty_q15[BOARD_WHEELS]) {
    GPIOA_BSRR = duty_q15[0] >= 0 ? UP(8) : DOWN(8);
    GPIOB_BSRR =
        (duty_q15[0] >= 0 ? DOWN(13) : UP(13)) | (duty_q15[1] >= 0 ? UP(0) | DOWN(1) : DOWN(0) | UP(1));
    TIM1_CCR2 = counts_of(duty_q15[0]);
    TIM1_CCR3 = counts_of(duty_q15[1]);
}

void board_set_wheels(const int32_t duty_q15[BOARD_WHEELS]) {
    if (!drives()) {
        return;
    }
    /* Interrupts off: else SysTick could switch off after the check, and this write would undo it. */
    __asm volatile("cpsid i" ::: "memory");
    if (!stall_latched() && (TIM1_BDTR & TIM1_BDTR_MOE) != 0U) {
        write(duty_q15);
    }
    __asm volatile("cpsie i" ::: "memory");
}

void motors_arm(void) {
    static const int32_t none[BOARD_WHEELS] = {0, 0};
    if (!drives()) {
        return;
    }
    __asm volatile("cpsid i" ::: "memory");
    if (!stall_latched()) {
        write(none);
        set_pwm_pins(PIN_ALTERNATE_10MHZ);
        TIM1_BDTR |= TIM1_BDTR_MOE;
    }
    __asm volatile("cpsie i" ::: "memory");
}

bool motors_on(void) {
    return drives() && (TIM1_BDTR & TIM1_BDTR_MOE) != 0U;
}

void motors_off(void) {
    if (drives()) {
        TIM1_BDTR &= ~TIM1_BDTR_MOE;
        GPIOB_BSRR = DOWN(0) | DOWN(1) | DOWN(13) | DOWN(14) | DOWN(15);
        set_pwm_pins(PIN_OUTPUT_10MHZ);
        GPIOA_BSRR = DOWN(8);
        TIM1_CCR2 = 0U; /* else the next arming would begin with the half period of an old duty */
        TIM1_CCR3 = 0U;
    }
}

uint32_t motors_faults(void) {
    return drives() && (TIM1_SR & TIM1_SR_BIF) != 0U ? BOARD_FAULT_BRIDGE : 0U;
}

void motors_clear_faults(void) {
    if (drives()) {
        TIM1_SR = ~TIM1_SR_BIF; /* stays set while the input is active */
    }
}
