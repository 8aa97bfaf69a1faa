/* The control period: TIM3 counts it and starts the sampling; a complete sample is the tick (RM0008 15.3,
 * 15.4). The timer's trigger output starts the ADC in hardware, so that no instruction takes part in the
 * timing of a sample. The timer's interrupt starts the digital sensors. Without sensors that interrupt is the
 * tick.
 *
 * With analog inputs the timer triggers at least once per millisecond, whatever the period. The last trigger
 * of a period starts the sample; each of the others starts one scan, which is only checked for railed and
 * stuck inputs. When a period does not divide evenly, its intervals differ by 1 us; each interval is loaded
 * one update ahead (ARPE).
 */
#include "sampling.h"
#include "adc.h"
#include "app/board_guard.h"
#include "app/board_sensors.h"
#include "clock.h"
#include "generated/sensor_kinds.h"
#include "imu.h"
#include "nvic.h"
#include "samples.h"
#include "stm32f103.h"

#define INTERVAL_MAX_US 1000U /* between two scans of the analog inputs */

BOARD_GUARDED static board_sensors_t sensors;
BOARD_GUARDED static uint32_t running_us;  /* 0: stopped */
BOARD_GUARDED static uint32_t triggers;    /* updates of TIM3 per period */
static uint32_t trigger;                   /* updates since the last one that ended a period */
BOARD_GUARDED static uint32_t interval_us; /* between two updates */
BOARD_GUARDED static uint32_t longer;      /* intervals of a period that take 1 us more */
static uint32_t carried;                   /* remainder of that division, from interval to interval */

static bool analog(void) {
    return board_sensors_analog(sensors.kind);
}

/* Reload value of the next interval: its length in counts of TIM3, less 1. The intervals of a period sum to
 * exactly that period. */
static uint32_t next_reload(void) {
    carried += longer;
    if (carried < triggers) {
        return interval_us - 1U;
    }
    carried -= triggers;
    return interval_us;
}

/* Divides the period into triggers: at least one per millisecond, as long as a sample of 2^oversample_log2
 * scans ends before the next trigger. That limit only matters for 16 scans and periods of 1001 to 1599 us. */
static void divide_period(uint32_t period_us) {
    const uint32_t fit = period_us / (BOARD_SCAN_US << sensors.oversample_log2);
    const uint32_t wanted = (period_us + INTERVAL_MAX_US - 1U) / INTERVAL_MAX_US;
    triggers = wanted < fit ? wanted : fit > 0U ? fit : 1U;
    interval_us = period_us / triggers;
    longer = period_us - triggers * interval_us;
    carried = 0U;
}

void sampling_timer_handler(void) {
    if ((TIM3_SR & TIM3_SR_UIF) == 0U) {
        return; /* already handled: the DMA's interrupt calls this function before it uses the scan */
    }
    TIM3_SR = 0U;
    if (longer > 0U) {
        TIM3_ARR = next_reload();
    }
    trigger++;
    if (trigger < triggers) {
        adc_triggered(false);
        return;
    }
    trigger = 0U;
    switch (sensors.kind) {
    case BOARD_SENSORS_NONE:
        samples_publish(); /* the counts come from the host */
        break;
    case BOARD_SENSORS_BALANCE:
    case BOARD_SENSORS_SIX_AXES:
    case BOARD_SENSORS_RIDE:
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
    TIM3_CR1 = 0U;
    TIM3_DIER = 0U;
    TIM3_CR2 = TIM3_CR2_MMS_UPDATE;
    adc_stop();
    if (period_us == 0U) {
        return;
    }
    /* 1 us a count, 2 us where 16 bits do not reach. An update event (UG) loads the prescaler, and is also a
     * trigger: the converter is set up after it, so that the first scan comes with the first full period. */
    const uint32_t step_us = period_us > 65536U && !analog() ? 2U : 1U;
    TIM3_PSC = clock_mhz() * step_us - 1U;
    triggers = 1U;
    longer = 0U;
    trigger = 0U;
    if (analog()) {
        divide_period(period_us);
        TIM3_ARR = next_reload();
    } else {
        TIM3_ARR = period_us / step_us - 1U;
    }
    TIM3_EGR = TIM3_EGR_UG;
    if (longer > 0U) {
        TIM3_CR1 = TIM3_CR1_ARPE;
        TIM3_ARR = next_reload();
    }
    TIM3_SR = 0U;
    nvic_forget(IRQ_TIM3);
    nvic_enable(IRQ_TIM3);
    samples_clear();
    if (analog()) {
        adc_start(&sensors, interval_us);
    }
    TIM3_DIER = TIM3_DIER_UIE;
    TIM3_CR1 |= TIM3_CR1_CEN;
}

/* Word by word: the library's comparison takes three times as long, on every whole turn. */
static bool same(const board_sensors_t *a, const board_sensors_t *b) {
    const uint32_t different = (a->kind ^ b->kind) | (a->oversample_log2 ^ b->oversample_log2) |
                               (a->rail_ms ^ b->rail_ms) | (a->stuck_ms ^ b->stuck_ms) |
                               (a->accel_bus ^ b->accel_bus) | (a->accel_rate ^ b->accel_rate) |
                               (a->gyro_filter ^ b->gyro_filter) | (a->imu_axis ^ b->imu_axis) |
                               (a->marks_missing ^ b->marks_missing);
    return different == 0U;
}

void board_use_sensors(const board_sensors_t *wanted) {
    if (same(&sensors, wanted)) {
        return;
    }
    const uint32_t period_us = running_us;
    board_set_period_us(0U);
    __asm volatile("cpsid i" ::: "memory");
    sensors = *wanted;
    imu_use(wanted);
    __asm volatile("cpsie i" ::: "memory");
    board_set_period_us(period_us);
}

bool board_tick_waits(void) {
    return running_us != 0U && samples_wait();
}

bool board_take_tick(void) {
    if (running_us == 0U) {
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
