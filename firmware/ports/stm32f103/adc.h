/* Analog sensors on ADC1, scanned when TIM3 triggers. Interrupts call adc_triggered() and adc_on_scan(); the
 * main loop calls the others. An image without analog sensors has no adc.c. */
#ifndef PLUMB_STM32F103_ADC_H
#define PLUMB_STM32F103_ADC_H

#include "app/board_sensors.h"
#include "generated/used_parts.h"

/* Set up the converter; TIM3 triggers it every interval_us. */
void adc_start(const board_sensors_t *sensors, uint32_t interval_us);

/* Restarts a converter that delivers nothing, at most every 20 ms. Call on every turn of the loop while
 * analog sensors are in use. */
void adc_poll(void);

#if USED_ANALOG
void adc_stop(void);

/* True while no conversions come, or when the calibration did not end. */
bool adc_failed(void);

/* Fills railed and stuck. */
void adc_health(board_health_t *health);

/* From TIM3's interrupt. begins_sample: the period's sample starts with this trigger's scan. */
void adc_triggered(bool begins_sample);

/* From the DMA's interrupt, after adc_triggered(): a scan is stored. */
void adc_on_scan(void);
#else
static inline void adc_stop(void) {}
static inline bool adc_failed(void) {
    return false;
}
static inline void adc_health(board_health_t *health) {
    health->railed = 0U;
    health->stuck = 0U;
}
static inline void adc_triggered(bool begins_sample) {
    (void)begins_sample;
}
static inline void adc_on_scan(void) {}
#endif

#endif
