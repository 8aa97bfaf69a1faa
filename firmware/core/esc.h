/* Bounds of the pulses for speed controllers with one-way PWM, in half-microseconds.
 *
 * The port clamps every pulse to these bounds where it writes the timer's registers, so they hold at the pin
 * even when a parameter, memory or a frame is wrong. Two-way (3D) controllers, OneShot125, OneShot42,
 * Multishot and DShot need other pulses and are not supported. */
#ifndef PLUMB_CORE_ESC_H
#define PLUMB_CORE_ESC_H

#include "plumb/params.h"
#include <stdbool.h>

#define ESC_PULSE_MIN_HALFUS   1800 /* 900 us */
#define ESC_PULSE_MAX_HALFUS   4200 /* 2100 us */
#define ESC_NEUTRAL_MAX_HALFUS 2200 /* 1100 us: largest that the table takes */
#define ESC_OFF_MAX_HALFUS     2100 /* 1050 us: largest that is sent; a controller may start at 1060 us */
#define ESC_SPAN_MAX_HALFUS    (ESC_PULSE_MAX_HALFUS - ESC_PULSE_MIN_HALFUS)
#define ESC_FRAME_MIN_HALFUS   4080  /* 490 Hz */
#define ESC_FRAME_MAX_HALFUS   40000 /* 50 Hz */
#define ESC_GAP_MIN_HALFUS     40    /* between two pulses: 20 us low */

/* A frame that is ended early, because its pulses must not drive any longer: room for the longest pulse and
 * the gap behind it. */
#define ESC_FRAME_ENDED_HALFUS (ESC_PULSE_MAX_HALFUS + ESC_GAP_MIN_HALFUS)

/* True when ESC_PULSE_MIN_HALFUS <= neutral <= min <= mid <= max <= ESC_PULSE_MAX_HALFUS, neutral is at most
 * ESC_NEUTRAL_MAX_HALFUS and |span| at most ESC_SPAN_MAX_HALFUS. */
bool plumb_esc_valid(const plumb_esc_params_t *p);

#endif
