/* The control period: TIM3 counts it, starts what is to be sampled, and a complete sample is the tick (RM0008
 * 15.3, 15.4). Analog inputs are started by the timer's trigger itself, so that no instruction takes part in
 * the timing of a sample; the digital sensors by its interrupt. Without sensors the interrupt is the tick.
 *
 * With analog inputs the timer triggers at least once per millisecond, whatever the period: the last trigger
 * of a period starts the sample, the others start one scan each, which only the watch over the inputs sees.
 * A period that cannot be divided evenly has intervals that differ by 1 us, loaded one update ahead (ARPE).
 */
#include "sampling.h"
#include "adc.h"
#include "app/board_guard.h"
#include "app/board_sensors.h"
#include "clock.h"
#include "imu.h"
#include "nvic.h"
#include "samples.h"
#include "stm32f103.h"
#include <string.h>

#define INTERVAL_MAX_US 1000u /* between two scans of the analog inputs */

BOARD_GUARDED static board_sensors_t use;
BOARD_GUARDED static uint32_t running_us;  /* 0: stopped */
BOARD_GUARDED static uint32_t triggers;    /* updates of TIM3 per period */
static uint32_t trigger;                   /* updates since the last one that ended a period */
BOARD_GUARDED static uint32_t interval_us; /* between two updates; `longer` of a period take 1 us more */
BOARD_GUARDED static uint32_t longer;
static uint32_t share;

static bool analog(void) {
    return use.kind == BOARD_SENSORS_ANALOG_3 || use.kind == BOARD_SENSORS_ANALOG_6;
}

/* The next interval in counts of TIM3, less 1. Over one period the intervals sum up to it exactly. */
static uint32_t next_reload(void) {
    share += longer;
    if (share < triggers) {
        return interval_us - 1u;
    }
    share -= triggers;
    return interval_us;
}

/* Scans per period: one per millisecond at least, as long as a sample of 2^oversample_log2 scans ends before
 * the next trigger. That limit only matters for 16 scans and periods of 1001 to 1599 us. */
static void divide(uint32_t period_us) {
    const uint32_t fit = period_us / (BOARD_SCAN_US << use.oversample_log2);
    const uint32_t wanted = (period_us + INTERVAL_MAX_US - 1u) / INTERVAL_MAX_US;
    triggers = wanted < fit ? wanted : fit > 0u ? fit : 1u;
    interval_us = period_us / triggers;
    longer = period_us - triggers * interval_us;
    share = 0u;
}

void sampling_timer_handler(void) {
    if ((TIM3_SR & TIM3_SR_UIF) == 0u) {
        return; /* the scan that it triggered was first */
    }
    TIM3_SR = 0u;
    if (longer > 0u) {
        TIM3_ARR = next_reload();
    }
    trigger++;
    if (trigger < triggers) {
        adc_triggered(false);
        return;
    }
    trigger = 0u;
    switch (use.kind) {
    case BOARD_SENSORS_NONE:
        samples_publish(); /* the counts come from the host */
        break;
    case BOARD_SENSORS_BALANCE:
        imu_period(running_us);
        break;
    default:
        adc_triggered(true);
        break;
    }
}

void board_set_period_us(uint32_t period_us) {
    if (period_us == running_us) {
        return;
    }
    running_us = period_us;
    RCC_APB1ENR |= RCC_APB1ENR_TIM3EN;
    TIM3_CR1 = 0u;
    TIM3_DIER = 0u;
    TIM3_CR2 = TIM3_CR2_MMS_UPDATE;
    adc_stop();
    if (period_us == 0u) {
        return;
    }
    /* 1 us a count, 2 us where 16 bits do not reach. The prescaler is taken over by an update event (UG),
     * which is also a trigger: the converter is set up after it, so that the first scan comes with the first
     * full period. */
    const uint32_t step_us = period_us > 65536u && !analog() ? 2u : 1u;
    TIM3_PSC = clock_mhz() * step_us - 1u;
    triggers = 1u;
    longer = 0u;
    trigger = 0u;
    if (analog()) {
        divide(period_us);
        TIM3_ARR = next_reload();
    } else {
        TIM3_ARR = period_us / step_us - 1u;
    }
    TIM3_EGR = TIM3_EGR_UG;
    if (longer > 0u) {
        TIM3_CR1 = TIM3_CR1_ARPE;
        TIM3_ARR = next_reload();
    }
    TIM3_SR = 0u;
    nvic_forget(IRQ_TIM3);
    nvic_enable(IRQ_TIM3);
    samples_clear();
    if (analog()) {
        adc_start(&use, interval_us);
    }
    TIM3_DIER = TIM3_DIER_UIE;
    TIM3_CR1 |= TIM3_CR1_CEN;
}

void board_use_sensors(const board_sensors_t *wanted) {
    if (memcmp(&use, wanted, sizeof use) == 0) {
        return;
    }
    const uint32_t period_us = running_us;
    board_set_period_us(0u);
    __asm volatile("cpsid i" ::: "memory");
    use = *wanted;
    imu_use(wanted);
    __asm volatile("cpsie i" ::: "memory");
    board_set_period_us(period_us);
}

bool board_take_tick(void) {
    if (running_us == 0u) {
        return false;
    }
    if (analog()) {
        adc_poll();
    }
    return samples_poll();
}

void board_read_sensors(int16_t raw[BOARD_RAW_MAX]) {
    samples_read(raw);
}

void board_sensor_health(board_health_t *health) {
    adc_health(health);
    imu_health(health);
}
