/* Parameters of a run: the control core's, then the link's and the board's. */
#ifndef PLUMB_LINK_PARAMS_H
#define PLUMB_LINK_PARAMS_H

#include "../core/control.h"

typedef struct {
    control_params_t control;
    uint32_t period_us;     /* control period */
    uint32_t esc_period_us; /* period of the speed controllers' pulses */
} params_t;

void params_default(params_t *p);

#endif
