/* How often a keep-alive over a slow and lossy link lets a board go: the session of the firmware, a channel
 * that delays every frame and loses some, and a host that answers each value when it comes. Simulated time;
 * seeded. */
#include "generated/messages.h"
#include "link/arming_reasons.h"
#include "link/requests.h"
#include "link/stepping.h"
#include <string.h>

#define TURN_US    500U
#define IN_CHANNEL 64U /* frames on their way, in one direction */
#define PPM        1000000U
#define ASKER      1U
#define SETTLE_US  100000U
#define READY_US   1000000U /* at rest from the first step on, a run may be armed by then */

uint32_t keepalive_study(uint32_t seconds, uint32_t round_trip_us, uint32_t loss_ppm, uint32_t frame_us,
                         uint32_t seed);

typedef struct {
    can_frame_t frame[IN_CHANNEL];
    uint32_t arrives_us[IN_CHANNEL];
    unsigned in, out;
} channel_t;

typedef struct {
    session_t session;
    session_buffers_t buffers;
    control_t control;
    params_t params;
    board_identity_t identity;
    channel_t up, down;
    random_t chance;
    uint32_t one_way_us, loss_ppm, now_us, tick_us;
    uint8_t counter;
} study_t;

static void send(study_t *s, channel_t *c, const can_frame_t *f) {
    if (random_next(&s->chance) % PPM >= s->loss_ppm && c->in - c->out < IN_CHANNEL) {
        c->frame[c->in % IN_CHANNEL] = *f;
        c->arrives_us[c->in % IN_CHANNEL] = s->now_us + s->one_way_us;
        c->in++;
    }
}

static bool arrived(study_t *s, channel_t *c, can_frame_t *f) {
    if (c->in == c->out || (int32_t)(s->now_us - c->arrives_us[c->out % IN_CHANNEL]) < 0) {
        return false;
    }
    *f = c->frame[c->out % IN_CHANNEL];
    c->out++;
    return true;
}

static can_frame_t from_host(study_t *s, uint16_t id, uint16_t half, uint32_t word) {
    can_frame_t f = {.id = id, .dlc = CAN_FRAME_DLC};

    f.data[2] = (uint8_t)(half & 0xFFU);
    f.data[3] = (uint8_t)(half >> 8);
    for (unsigned i = 0; i < 4U; i++) {
        f.data[4U + i] = (uint8_t)(word >> (8U * i) & 0xFFU);
    }
    e2e_seal(&f, s->counter++ & E2E_COUNTER_MASK, 0);
    return f;
}

static void say(study_t *s, uint16_t id, uint16_t half, uint32_t word) {
    const can_frame_t f = from_host(s, id, half, word);

    requests_receive_frame(&s->session, &f, s->now_us);
}

static uint16_t half_of(const can_frame_t *f) {
    return (uint16_t)(f->data[2] | f->data[3] << 8);
}

static uint32_t word_of(const can_frame_t *f) {
    return f->data[4] | (uint32_t)f->data[5] << 8 | (uint32_t)f->data[6] << 16 | (uint32_t)f->data[7] << 24;
}

/* Arm, without loss on the way; the reply goes through the channel. */
static void arm(study_t *s) {
    nonce_t *const nonce = &s->session.nonce[LINK_CAN];
    const uint16_t verb = MESSAGE_EXECUTE_VERB_ARM;

    say(s, MESSAGE_EXECUTE_ID, verb, nonce_issue(nonce, &s->session.random, verb, ASKER, s->now_us) ^ ASKER);
}

static void begin(study_t *s, uint32_t frame_us, uint32_t seed) {
    const uint16_t run = MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;

    memset(s, 0, sizeof *s);
    random_init(&s->chance, seed);
    s->identity = (board_identity_t){.unique_id = {seed}};
    params_default(&s->params);
    s->params.esc_period_us = frame_us;
    session_init(&s->session, &s->buffers, &s->identity, &s->control, &s->params, &(store_report_t){0});
    session_report(&s->session, &(session_report_t){0}, s->now_us); /* the arm switch is open */
    say(s, MESSAGE_HELLO_ID, MESSAGES_PROTOCOL_VERSION, MESSAGES_DBC_HASH);
    say(s, MESSAGE_RUN_BEGIN_ID, run,
        nonce_issue(&s->session.nonce[LINK_CAN], &s->session.random, run, 0, s->now_us));
}

/* One turn of the board's loop, and what the host says to what comes. */
static void turn(study_t *s) {
    can_frame_t f;

    while (arrived(s, &s->up, &f)) {
        if (f.id == MESSAGE_KEEPALIVE_VALUE_ID) {
            const can_frame_t answer = from_host(s, MESSAGE_KEEPALIVE_ID, half_of(&f), word_of(&f));
            send(s, &s->down, &answer);
        }
    }
    while (arrived(s, &s->down, &f)) {
        requests_receive_frame(&s->session, &f, s->now_us);
    }
    session_poll(&s->session, s->now_us);
    if (s->now_us - s->tick_us >= s->params.period_us) {
        /* Level and still, by the calibration of the default table. */
        int16_t raw[PLUMB_RAW_MAX] = {1676, 2048, 3041};
        int32_t setpoint;

        s->tick_us = s->now_us;
        (void)session_take_inputs(&s->session, raw, &setpoint);
        control_step(&s->control, &s->params.control, raw, setpoint);
        session_stepped(&s->session);
    }
    while (session_transmit_frame(&s->buffers, &f)) {
        send(s, &s->up, &f);
    }
}

/* How often the board disarms in so many seconds, armed again each time; UINT32_MAX: it cannot be armed. Half
 * of round_trip_us each way; loss_ppm of the frames of each direction; frame_us: of the pulses. */
uint32_t keepalive_study(uint32_t seconds, uint32_t round_trip_us, uint32_t loss_ppm, uint32_t frame_us,
                         uint32_t seed) {
    static study_t s;
    uint32_t disarmed = 0, idle_us = 0;

    begin(&s, frame_us, seed);
    while (s.now_us < READY_US) {
        s.now_us += TURN_US;
        turn(&s);
    }
    s.one_way_us = round_trip_us / 2U;
    s.loss_ppm = loss_ppm;
    arm(&s);
    if (!session_armed(&s.session)) {
        return UINT32_MAX;
    }
    for (uint64_t t_us = 0; t_us < seconds * UINT64_C(1000000); t_us += TURN_US) {
        s.now_us += TURN_US;
        turn(&s);
        if (session_armed(&s.session)) {
            idle_us = 0;
        } else if (idle_us == 0) {
            disarmed++;
            idle_us = TURN_US;
        } else if ((idle_us += TURN_US) > SETTLE_US) {
            arm(&s);
        }
    }
    return disarmed;
}
