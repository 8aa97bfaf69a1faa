#include "receiver.h"

#define STICK_MIN    172
#define STICK_MIDDLE 992
#define STICK_SPAN   819 /* from the middle to the upper end; one less than to the lower one */
#define STICK_WHOLE  1639
#define SWITCH_OFF   792 /* 1375 us of a pulse */
#define SWITCH_ON    1192
#define PULSE_OFFSET 1408  /* 8 / 5 of a pulse in us less this is the channel: 1500 us is the middle */
#define GESTURE_LOW  1638  /* of the throttle: 5 % */
#define GESTURE_YAW  29491 /* 90 % */

enum { ROLL, PITCH, THROTTLE, YAW, SWITCHES, USED = SWITCHES + RECEIVER_SWITCHES }; /* channels */
enum { WORD_ROLL, WORD_PITCH, WORD_YAW, WORD_SWITCHES, WORD_RECEIVER };

static int32_t within(int32_t value, int32_t least, int32_t most) {
    return value < least ? least : value > most ? most : value;
}

static int16_t stick_of(int32_t channel) {
    const int32_t away = channel - STICK_MIDDLE;

    return (int16_t)(within(away, -STICK_SPAN, STICK_SPAN) * INT16_MAX / STICK_SPAN);
}

static int16_t throttle_of(int32_t channel) {
    const int32_t up = channel - STICK_MIN;

    return (int16_t)(within(up, 0, STICK_WHOLE) * INT16_MAX / STICK_WHOLE);
}

/* A frame between the two positions asks for the present one. */
static void follow_switch(receiver_t *r, unsigned number, int32_t channel) {
    const int bit = 1 << number;
    const bool on = (r->words[WORD_SWITCHES] & bit) != 0;
    const bool turns = on ? channel < SWITCH_OFF : channel > SWITCH_ON;

    r->equal[number] = (uint8_t)(turns ? r->equal[number] + 1U : 0U);
    if (r->equal[number] == RECEIVER_EQUAL) {
        r->equal[number] = 0;
        r->words[WORD_SWITCHES] = (int16_t)(r->words[WORD_SWITCHES] ^ bit);
    }
}

/* Low throttle, and yaw at the end that asks for the other position. */
static void follow_gesture(receiver_t *r, uint32_t now_us) {
    const int32_t left = r->words[WORD_YAW];
    const bool asked = receiver_rotors_on(r) ? left >= GESTURE_YAW : left <= -GESTURE_YAW;

    const bool anew = r->silent || now_us - r->received_us > RECEIVER_SILENCE_US;

    if (!asked || r->throttle_q15 > GESTURE_LOW || anew) {
        r->gesture_us = now_us;
    } else if (now_us - r->gesture_us >= RECEIVER_GESTURE_US) {
        r->gesture_us = now_us;
        r->words[WORD_SWITCHES] ^= RECEIVER_ROTORS_ON;
    }
}

static void take_sticks(receiver_t *r, const int16_t channels[USED], uint32_t now_us) {
    r->throttle_q15 = throttle_of(channels[THROTTLE]);
    r->words[WORD_ROLL] = stick_of(channels[ROLL]);
    r->words[WORD_PITCH] = stick_of(channels[PITCH]);
    r->words[WORD_YAW] = (int16_t)-stick_of(channels[YAW]);
    if (r->by_sticks) {
        follow_gesture(r, now_us);
    } else {
        r->gesture_us = now_us;
    }
    for (unsigned i = r->by_sticks ? 1U : 0U; i < RECEIVER_SWITCHES; i++) {
        follow_switch(r, i, channels[SWITCHES + i]);
    }
    const bool off = !receiver_rotors_on(r) && (r->by_sticks || channels[SWITCHES] < SWITCH_OFF);

    r->off = (uint8_t)(!off ? 0U : r->off < RECEIVER_EQUAL ? r->off + 1U : r->off);
}

/* Handle a frame with these channels. One that the receiver makes up without its transmitter is a missing
 * one.
 */
static void take_frame(receiver_t *r, const int16_t channels[USED], uint32_t now_us) {
    if (r->lost) {
        r->gesture_us = now_us;
        return;
    }
    r->number = (uint8_t)(r->number % UINT8_MAX + 1U);
    take_sticks(r, channels, now_us);
    r->received_us = now_us;
    r->silent = false;
    r->words[WORD_RECEIVER] = r->number;
}

bool receiver_rotors_on(const receiver_t *r) {
    return (r->words[WORD_SWITCHES] & RECEIVER_ROTORS_ON) != 0;
}

bool receiver_rotors_off(const receiver_t *r) {
    return r->off >= RECEIVER_EQUAL;
}

bool receiver_present(receiver_t *r, uint32_t now_us) {
    r->silent = r->silent || now_us - r->received_us > RECEIVER_SILENCE_US;
    if (r->number != 0U && !r->silent && !r->lost) {
        return true;
    }
    r->off = 0;
    if (!receiver_rotors_on(r)) {
        r->equal[0] = 0; /* on again needs as many frames as ever; off counts those on either side of a gap */
    }
    return false;
}

/* Handle what has come, if it is a frame. */
static void take_event(receiver_t *r, const crsf_t *c, crsf_event_t event, uint32_t now_us) {
    int16_t channels[USED];

    switch (event) {
    case CRSF_STICKS:
        for (unsigned k = 0; k < USED; k++) {
            channels[k] = (int16_t)crsf_channel(c, k);
        }
        take_frame(r, channels, now_us);
        break;
    case CRSF_STATISTICS:
        r->lost = crsf_link_quality(c) == 0U;
        break;
    case CRSF_NOTHING:
        break;
    }
}

void receiver_push(receiver_t *r, crsf_t *c, const uint8_t *bytes, size_t count, uint32_t now_us) {
    for (size_t i = 0; i < count; i++) {
        take_event(r, c, crsf_push(c, bytes[i]), now_us);
        r->byte_us = now_us;
    }
    /* Else what a false length holds back would count as new with the bytes that come next, however late. */
    if (now_us - r->byte_us > RECEIVER_PAUSE_US) {
        for (crsf_event_t event = crsf_pause(c); event != CRSF_NOTHING; event = crsf_pause(c)) {
            take_event(r, c, event, now_us);
        }
    }
}

void receiver_pulses(receiver_t *r, const uint16_t pulse_us[PPM_CHANNELS], uint32_t now_us) {
    int16_t channels[USED];

    for (unsigned k = 0; k < USED; k++) {
        channels[k] = (int16_t)((int32_t)(8U * pulse_us[k] / 5U) - PULSE_OFFSET);
    }
    r->lost = pulse_us[THROTTLE] < RECEIVER_LOST_US;
    take_frame(r, channels, now_us);
}
