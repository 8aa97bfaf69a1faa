/* Receiver: the channels of a pilot's transmitter as setpoint and commands of a step.
 *
 *     channel 1  roll      right is positive: lowers the right side
 *     channel 2  pitch     forward is positive: lowers the nose
 *     channel 3  throttle  the setpoint
 *     channel 4  yaw       right is negative: turns to the right, seen from above
 *     channel 5  rotors    high is on
 *     channel 6  mode      high is rate, else level
 *
 * A stick from 172 over 992 to 1811 is -32767 over 0 to 32767, the throttle from 172 to 1811 is 0 to 32767;
 * beyond that they stay at the end. A switch turns on above 1192 and off below 792; in between it stays. A
 * change counts after it was asked for by RECEIVER_EQUAL frames in a row; the rotors turn on by frames
 * without a time in between in which the receiver was lost.
 *
 * The commands are those that a system with `command_source = "receiver"` declares first. While the link
 * quality is 0, frames count as missing, and sticks and switches stay as they are: what a receiver makes up
 * then moves nothing. How long ago the last frame came is counted within the step, from the number of the
 * frame; what may be armed asks receiver_present(), which knows the time.
 *
 * Of a pulse train 988, 1500 and 2012 us are what 172, 992 and 1811 are of CRSF, and the link quality is 0
 * while the throttle is below RECEIVER_LOST_US.
 *
 * With `by_sticks` the sticks switch the rotors in place of channel 5: throttle low, and yaw at its right end
 * for RECEIVER_GESTURE_US, is on; at its left end, off.
 */
#ifndef PLUMB_LINK_RECEIVER_H
#define PLUMB_LINK_RECEIVER_H

#include "crsf.h"
#include "ppm.h"
#include <stdbool.h>

#define RECEIVER_EQUAL    3U
#define RECEIVER_SWITCHES 2U
#define RECEIVER_WORDS    5U

#define RECEIVER_ROTORS_ON 1 /* bits of the word of switches */
#define RECEIVER_MODE_RATE 2

/* The parameter `receiver`: 0 none, 1 and 2 CRSF, from here on PPM; where it is even the sticks switch. */
#define RECEIVER_PPM     3U
#define RECEIVER_LOST_US 950U /* throttle of a pulse train below which the receiver says that it is lost */

#define RECEIVER_SILENCE_US 100000U  /* without a frame for so long it is lost */
#define RECEIVER_PAUSE_US   5000U    /* without a byte for so long no frame is under way */
#define RECEIVER_GESTURE_US 1000000U /* that sticks are held to switch the rotors */

/* Zero at the start: no frame has come yet. */
typedef struct {
    int16_t throttle_q15;
    int16_t words[RECEIVER_WORDS];    /* roll, pitch, yaw, Q15; switches; number of the frame */
    uint8_t number;                   /* of the newest frame, 1 to 255 in a circle; 0: none has come */
    uint8_t equal[RECEIVER_SWITCHES]; /* frames in a row that ask for the other position */
    uint8_t off;          /* frames in a row with the rotors off, to RECEIVER_EQUAL; 0: no frame yet */
    bool lost;            /* the link quality is 0 */
    bool silent;          /* no frame for RECEIVER_SILENCE_US */
    bool by_sticks;       /* the caller's choice: the sticks switch the rotors */
    uint32_t byte_us;     /* when the newest bytes came */
    uint32_t received_us; /* when the newest frame of channels came */
    uint32_t gesture_us;  /* since when the sticks ask for the other position */
} receiver_t;

/* Handle bytes of the line, which came until now. Call on every whole turn of the loop, with none, too: it
 * sees the pause. */
void receiver_push(receiver_t *r, crsf_t *c, const uint8_t *bytes, size_t count, uint32_t now_us);

/* Handle a frame of a pulse train, which has ended now. */
void receiver_pulses(receiver_t *r, const uint16_t pulse_us[PPM_CHANNELS], uint32_t now_us);

/* True while frames come and the transmitter reaches the receiver. Call on every whole turn of the loop: it
 * sees the silence. */
bool receiver_present(receiver_t *r, uint32_t now_us);

/* True when the pilot has the rotors switched on, by the newest frames that counted. */
bool receiver_rotors_on(const receiver_t *r);

/* True when RECEIVER_EQUAL frames in a row, all since frames come, had the rotors off. Not the
 * opposite of receiver_rotors_on(): a switch that is on is taken as off until as many frames say on. */
bool receiver_rotors_off(const receiver_t *r);

#endif
