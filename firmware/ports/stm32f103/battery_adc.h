/* ADC2 on PB0 and PB1: the battery, in pin set `quadrotor`. battery_adc.c implements app/board_battery.h. */
#ifndef PLUMB_STM32F103_BATTERY_ADC_H
#define PLUMB_STM32F103_BATTERY_ADC_H

void battery_adc_init(void);

#endif
