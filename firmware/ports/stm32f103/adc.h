/* Analog sensors on ADC1, scanned when TIM3 triggers. All but adc_on_scan() and adc_triggered() are the
 * loop's. */
#ifndef PLUMB_STM32F103_ADC_H
#define PLUMB_STM32F103_ADC_H

#include "app/board_sensors.h"

/* interval_us: between two triggers. */
void adc_start(const board_sensors_t *use, uint32_t interval_us);
void adc_stop(void);

/* Tries again when conversions do not come. Call on every turn of the loop while analog sensors are in use.
 */
void adc_poll(void);

/* Conversions do not come, or calibration did not end. */
bool adc_failed(void);

/* Fills railed and stuck. */
void adc_health(board_health_t *health);

/* From the interrupt of the trigger. */
void adc_triggered(bool begins_sample);

/* From the interrupt of the DMA: a scan is stored. Its trigger's interrupt was handled before. */
void adc_on_scan(void);

#endif
