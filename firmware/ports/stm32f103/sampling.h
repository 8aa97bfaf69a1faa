/* Control period on TIM3. sampling.c implements app/board_sensors.h. */
#ifndef PLUMB_STM32F103_SAMPLING_H
#define PLUMB_STM32F103_SAMPLING_H

/* TIM3's update interrupt: counts a trigger, which may begin a sample. Does nothing when no update is
 * pending. */
void sampling_timer_handler(void);

#endif
