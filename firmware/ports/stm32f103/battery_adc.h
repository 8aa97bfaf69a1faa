/* ADC2: the battery, on PB0 and PB1 in the pin set quadrotor, on PA2 in the pin set wheels. battery_adc.c
 * implements app/board_battery.h. */
#ifndef PLUMB_STM32F103_BATTERY_ADC_H
#define PLUMB_STM32F103_BATTERY_ADC_H

#include <stdint.h>

/* pins: BOARD_PINS_, one of these two sets. */
void battery_adc_init(uint32_t pins);

#endif
