#include "receiver.h"

#define STICK_MIN    172
#define STICK_MIDDLE 992
#define STICK_SPAN   819 /* from the middle to the upper end; one less than to the lower one */
#define STICK_WHOLE  1639
#define SWITCH_OFF   792 /* 1375 us of a pulse */
#define SWITCH_ON    1192

enum { ROLL, PITCH, THROTTLE, YAW, SWITCHES }; /* channels */
enum { WORD_ROLL, WORD_PITCH, WORD_YAW, WORD_SWITCHES, WORD_RECEIVER };

static int32_t within(int32_t value, int32_t least, int32_t most) {
    return value < least ? least : value > most ? most : value;
}

static int16_t stick_of(const crsf_t *c, unsigned channel) {
    const int32_t away = crsf_channel(c, channel) - STICK_MIDDLE;

    return (int16_t)(within(away, -STICK_SPAN, STICK_SPAN) * INT16_MAX / STICK_SPAN);
}

static int16_t throttle_of(const crsf_t *c) {
    const int32_t up = crsf_channel(c, THROTTLE) - STICK_MIN;

    return (int16_t)(within(up, 0, STICK_WHOLE) * INT16_MAX / STICK_WHOLE);
}

/* A frame between the two positions asks for the present one. */
static void follow_switch(receiver_t *r, unsigned number, uint16_t channel) {
    const int bit = 1 << number;
    const bool on = (r->words[WORD_SWITCHES] & bit) != 0;
    const bool turns = on ? channel < SWITCH_OFF : channel > SWITCH_ON;

    r->equal[number] = (uint8_t)(turns ? r->equal[number] + 1U : 0U);
    if (r->equal[number] == RECEIVER_EQUAL) {
        r->equal[number] = 0;
        r->words[WORD_SWITCHES] = (int16_t)(r->words[WORD_SWITCHES] ^ bit);
    }
}

static void take_sticks(receiver_t *r, const crsf_t *c) {
    r->throttle_q15 = throttle_of(c);
    r->words[WORD_ROLL] = stick_of(c, ROLL);
    r->words[WORD_PITCH] = stick_of(c, PITCH);
    r->words[WORD_YAW] = (int16_t)-stick_of(c, YAW);
    for (unsigned i = 0; i < RECEIVER_SWITCHES; i++) {
        follow_switch(r, i, crsf_channel(c, SWITCHES + i));
    }
}

void receiver_push(receiver_t *r, crsf_t *c, const uint8_t *bytes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        switch (crsf_push(c, bytes[i])) {
        case CRSF_STICKS:
            r->number = (uint8_t)(r->number % UINT8_MAX + 1U);
            if (!r->lost) {
                take_sticks(r, c);
            }
            break;
        case CRSF_STATISTICS:
            r->lost = crsf_link_quality(c) == 0U;
            break;
        case CRSF_NOTHING:
            continue;
        }
        r->words[WORD_RECEIVER] = (int16_t)(r->number + (r->lost ? RECEIVER_LOST : 0));
    }
}
