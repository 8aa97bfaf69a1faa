/* TIM1 channel 1 on PA8: the pulse train of a radio receiver, in pin set `quadrotor`. */
#ifndef PLUMB_STM32F103_PPM_CAPTURE_H
#define PLUMB_STM32F103_PPM_CAPTURE_H

void ppm_capture_init(void);
void ppm_capture_handler(void);

#endif
