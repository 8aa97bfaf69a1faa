/* The control period on TIM3: board_set_period_us() and its neighbours of app/board_sensors.h. */
#ifndef PLUMB_STM32F103_SAMPLING_H
#define PLUMB_STM32F103_SAMPLING_H

/* TIM3's interrupt: a trigger, which may begin a sample. May be called when it is not pending. */
void sampling_timer_handler(void);

#endif
