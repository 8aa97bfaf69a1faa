/* The inputs of a battery's voltage and current. Images without a system that flies have none of this. */
#ifndef PLUMB_BOARD_BATTERY_H
#define PLUMB_BOARD_BATTERY_H

#include <stdbool.h>
#include <stdint.h>

#define BATTERY_INPUTS 2U /* voltage, current */

/* The newest counts, 0 to 4095 of 3.3 V; false while there are none that were not read yet. Call on every
 * whole turn of the loop: each call also starts the next conversion. */
bool board_battery_read(uint16_t counts[BATTERY_INPUTS]);

#endif
