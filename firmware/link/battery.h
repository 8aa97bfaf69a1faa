/* Battery of a vehicle: two analog inputs, its voltage by a divider and its current by a sensor.
 *
 * A battery is declared by the parameter `battery_min_mv`, the lowest voltage to take off with; 0 declares
 * none, and then nothing is missing. The voltage is smoothed with a time constant of 64 ms, because speed
 * controllers draw their current in pulses. It begins at 0, so a battery is not known before its first
 * readings. Full scale, `battery_full_mv` and `battery_full_a`, is what 4096 counts stand for. */
#ifndef PLUMB_LINK_BATTERY_H
#define PLUMB_LINK_BATTERY_H

#include "app/board_battery.h"
#include "generated/messages.h"
#include "generated/params.h"
#include <stdbool.h>
#include <stdint.h>

#define BATTERY_SMOOTH_LOG2 6U
#define BATTERY_STEP_US     1000U /* between two steps of the smoothing */
#define BATTERY_STEPS_MAX   10U   /* at once: longer than turns are apart */
#define BATTERY_KNOWN_STEPS 200U  /* without a reading: the voltage is not known */
#define BATTERY_RAIL        4094U /* smoothed count from which on the input is at its rail */
#define BATTERY_LEAST_MV    2500U /* no battery has less: a wire is open, or USB feeds the board */

/* Zero at the start. */
typedef struct {
    uint32_t voltage_q6; /* count, smoothed */
    uint32_t us;         /* of the last step of the smoothing */
    uint16_t current;    /* count */
    uint8_t known_steps; /* until a voltage that is not read again is not known */
} battery_t;

/* Call on every whole turn of the loop. read: there are new counts, 0 to 4095. */
void battery_follow(battery_t *b, bool read, const uint16_t counts[BATTERY_INPUTS], uint32_t now_us);

/* READINESS_BATTERY_: what keeps a vehicle with a declared battery on the ground. */
uint16_t battery_missing(const battery_t *b, const params_t *params);

message_battery_t battery_message(const battery_t *b, const params_t *params);

#endif
