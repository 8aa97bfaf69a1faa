/* Commands that come with a setpoint, in a build whose systems have some: silence, disarming, arming, limits.
 * Built by tests/systems/test_declared_systems.py with the files that are generated for the toy system. */
#include "generated/messages.h"
#include "link/setpoint.h"
#include <stdio.h>

#define CHECK(condition)                                                                                     \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            printf("line %d: %s\n", __LINE__, #condition);                                                   \
            failed = 1;                                                                                      \
        }                                                                                                    \
    } while (0)

static int failed;
static const plumb_params_t toy = {.system = PLUMB_SYSTEM_TOY};

/* Replies go nowhere. */
void routing_answer(routing_t *r, link_t link, can_frame_t frame, uint8_t flags) {
    (void)r, (void)link, (void)frame, (void)flags;
}

static can_frame_t frame_of(unsigned index, uint8_t number, int16_t first, int16_t second, int16_t third) {
    can_frame_t f = messages_pair((uint16_t)(MESSAGE_COMMAND_A_ID + index), (uint16_t)first,
                                  (uint16_t)second | (uint32_t)(uint16_t)third << 16);
    e2e_seal(&f, number, 1U);
    return f;
}

/* The frames of a set of step `number` with this gain; heading and trim stay in their limits. */
static void receive(setpoint_t *s, uint16_t number, int16_t gain, uint16_t next_step) {
    const can_frame_t first = frame_of(0, number & 15U, gain, 1, 2),
                      second = frame_of(1, number & 15U, 3, 0, 2);

    command_set_receive(&s->commands, 0, &first, next_step);
    command_set_receive(&s->commands, 1, &second, next_step);
}

/* A set of step `number` with this heading, in halves. */
static void receive_heading(setpoint_t *s, uint16_t number, int16_t high, int16_t low) {
    const can_frame_t first = frame_of(0, number & 15U, 0, low, high),
                      second = frame_of(1, number & 15U, 3, 0, 2);

    command_set_receive(&s->commands, 0, &first, number);
    command_set_receive(&s->commands, 1, &second, number);
}

static int16_t gain_of(const setpoint_t *s) {
    int16_t raw[PLUMB_RAW_MAX] = {0};

    setpoint_copy_commands(s, raw);
    return raw[9];
}

static setpoint_t with_gain(int16_t gain) {
    setpoint_t s = {0};

    setpoint_begin(&s, control_system(&toy));
    receive(&s, 0, gain, 0);
    CHECK(setpoint_refused(&s, 0, 0) == 0U);
    setpoint_receive(&s, 0);
    setpoint_poll(&s, false, false, 0, 0);
    return s;
}

static void limits(void) {
    setpoint_t s = with_gain(-3);

    CHECK(gain_of(&s) == -3);
    receive(&s, 1, 4, 1);
    CHECK(setpoint_refused(&s, 1, 1) == MESSAGE_NACK_REASON_RANGE && gain_of(&s) == -3);
    receive(&s, 1, -4, 1);
    CHECK(setpoint_refused(&s, 1, 1) == MESSAGE_NACK_REASON_RANGE);
    receive_heading(&s, 1, 0x4000, 1);
    CHECK(setpoint_refused(&s, 1, 1) == MESSAGE_NACK_REASON_RANGE); /* 1 above its limit */
    receive_heading(&s, 1, 0x4000, 0);
    CHECK(setpoint_refused(&s, 1, 1) == 0U);
    receive_heading(&s, 1, -0x4000, 0);
    CHECK(setpoint_refused(&s, 1, 1) == 0U);
    receive_heading(&s, 1, -0x4001, -1);
    CHECK(setpoint_refused(&s, 1, 1) == MESSAGE_NACK_REASON_RANGE); /* 1 below */
    receive(&s, 1, 3, 1);
    CHECK(setpoint_refused(&s, 2, 2) == MESSAGE_NACK_REASON_SEQUENCE); /* of another step */
    CHECK(setpoint_refused(&s, 1, 9) == MESSAGE_NACK_REASON_SEQUENCE); /* 8 steps ago */
    CHECK(setpoint_refused(&s, 1, 8) == 0U);
}

/* The setpoint is 0 all the while: commands that are not neutral have to be said again, too. */
static void silence(void) {
    setpoint_t s = with_gain(2);

    setpoint_poll(&s, true, true, 0, 0);
    receive(&s, 1, 2, 1);
    setpoint_receive(&s, 0);
    setpoint_poll(&s, true, true, 0, 1000U);
    setpoint_poll(&s, true, true, 0, 1000U + SETPOINT_SILENCE_US);
    CHECK(gain_of(&s) == 2 && !s.timed_out);
    setpoint_poll(&s, true, true, 0, 1001U + SETPOINT_SILENCE_US);
    CHECK(gain_of(&s) == 1 && s.timed_out);
}

static void arming(void) {
    setpoint_t s = with_gain(2);

    setpoint_poll(&s, true, false, 0, 1U);
    CHECK(gain_of(&s) == 1); /* the board was armed: commands begin anew */
    receive(&s, 1, 3, 1);
    setpoint_receive(&s, 0);
    setpoint_poll(&s, true, true, 0, 2U);
    CHECK(gain_of(&s) == 3);
    setpoint_poll(&s, false, false, 0, 3U);
    CHECK(gain_of(&s) == 1);
}

int main(void) {
    limits();
    silence();
    arming();
    return failed;
}
