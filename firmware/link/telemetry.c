#include "telemetry.h"
#include "core/digest.h"
#include "messages.h"
#include <string.h>

/* RAW carries the low six bits of its step number: four as the counter, two as flags. */
#define STEP6_SHIFT    4U
#define FLAG_STEP_HIGH 3U

/* Bits of SELECT bank 0. */
#define FRAME_RAW_A      0x01U
#define FRAME_RAW_B      0x02U
#define FRAME_ANGLE      0x04U
#define FRAME_BIAS       0x08U
#define FRAME_RATE       0x10U
#define FRAME_MEASURED   0x20U
#define FRAME_COMMAND    0x40U
#define FRAME_DRIVE      0x80U
#define FRAME_ROLL       0x100U
#define FRAME_ROLL_BIAS  0x200U
#define FRAME_ATTITUDE_W 0x0400U
#define FRAME_ATTITUDE_X 0x0800U
#define FRAME_ATTITUDE_Y 0x1000U
#define FRAME_ATTITUDE_Z 0x2000U
#define FRAMES_RAW       (FRAME_RAW_A | FRAME_RAW_B)
#define FRAMES_QUAD      (FRAMES_RAW | FRAME_ANGLE | FRAME_BIAS | FRAME_RATE | FRAME_MEASURED | FRAME_COMMAND)
#define FRAMES_BALANCER  (FRAMES_QUAD | FRAME_DRIVE)
#define FRAMES_TURNTABLE                                                                                     \
    (FRAMES_RAW | FRAME_ATTITUDE_W | FRAME_ATTITUDE_X | FRAME_ATTITUDE_Y | FRAME_ATTITUDE_Z)
#define FRAMES_PHONE (FRAMES_RAW | FRAME_ANGLE | FRAME_BIAS | FRAME_ROLL | FRAME_ROLL_BIAS)

/* ---- selection ---- */

static uint16_t bits_set(uint32_t mask) {
    uint16_t count = 0;

    for (; mask != 0; mask &= mask - 1U) {
        count++;
    }
    return count;
}

/* Frames that the selected system has. */
static uint32_t system_frames(const control_params_t *params) {
    switch (params->system) {
    case CONTROL_BALANCER:
        return FRAMES_BALANCER;
    case CONTROL_PHONE:
        return FRAMES_PHONE;
    case CONTROL_TURNTABLE:
        return FRAMES_TURNTABLE;
    default:
        return FRAMES_QUAD;
    }
}

/* The bits of a bank of words that lie inside the record. */
static uint32_t words_inside(const control_params_t *params, uint32_t first) {
    const uint32_t record = (uint32_t)control_words_bytes(params) / 4U;

    if (record <= first) {
        return 0;
    }
    return record - first >= 32U ? 0xFFFFFFFFU : (1U << (record - first)) - 1U;
}

void telemetry_select(telemetry_t *t, const control_params_t *params, uint16_t bank, uint32_t mask) {
    if (bank == 0) {
        t->frames_mask = mask & system_frames(params);
        t->selected = (uint16_t)(1U + bits_set(t->frames_mask)); /* and STEP */
    } else {
        t->words_mask[bank - 1U] = mask & words_inside(params, 32U * (bank - 1U));
    }
}

void telemetry_select_nothing(telemetry_t *t) {
    t->frames_mask = 0;
    t->selected = 1; /* STEP */
    memset(t->words_mask, 0, sizeof t->words_mask);
}

void telemetry_init(telemetry_t *t, uint32_t *digest) {
    *t = (telemetry_t){.digest = digest};
    telemetry_select_nothing(t);
}

void telemetry_begin(telemetry_t *t) {
    t->word_next = CONTROL_RECORD_WORDS_MAX;
}

/* ---- frames out ---- */

static uint8_t flags_on(const telemetry_t *t, const routing_t *r, unsigned link, uint8_t flags) {
    const bool dropped = t->dropped_told[link] != r->link[link].outbox->dropped;

    return (uint8_t)(flags | (dropped ? MESSAGE_STEP_DROPPED : 0U));
}

/* Every record begins with the raw counts. */
static void send_raw(const telemetry_t *t, routing_t *r, uint16_t step, const int32_t raw[CONTROL_RAW_MAX]) {
    const message_raw_a_t a = {(int16_t)raw[0], (int16_t)raw[1], (int16_t)raw[2]};
    const message_raw_b_t b = {(int16_t)raw[3], (int16_t)raw[4], (int16_t)raw[5]};
    const uint8_t low = (uint8_t)(step & E2E_COUNTER_MASK);
    const uint8_t high = (uint8_t)((step >> STEP6_SHIFT) & FLAG_STEP_HIGH);

    if ((t->frames_mask & FRAME_RAW_A) != 0) {
        routing_numbered(r, message_raw_a_pack(&a), low, high);
    }
    if ((t->frames_mask & FRAME_RAW_B) != 0) {
        routing_numbered(r, message_raw_b_pack(&b), low, high);
    }
}

/* What every system of one axis has names for. */
typedef struct {
    message_angle_t angle;
    message_bias_t bias;
    message_rate_t rate;
    message_measured_t measured;
    message_command_t command;
} axis_t;

static void send_axis(routing_t *r, uint32_t mask, const axis_t *m, uint8_t step_low) {
    if ((mask & FRAME_ANGLE) != 0) {
        routing_telemetry(r, message_angle_pack(&m->angle), step_low);
    }
    if ((mask & FRAME_BIAS) != 0) {
        routing_telemetry(r, message_bias_pack(&m->bias), step_low);
    }
    if ((mask & FRAME_RATE) != 0) {
        routing_telemetry(r, message_rate_pack(&m->rate), step_low);
    }
    if ((mask & FRAME_MEASURED) != 0) {
        routing_telemetry(r, message_measured_pack(&m->measured), step_low);
    }
    if ((mask & FRAME_COMMAND) != 0) {
        routing_telemetry(r, message_command_pack(&m->command), step_low);
    }
}

static void send_quad(routing_t *r, uint32_t mask, const quad_words_t *w, uint8_t step_low) {
    const axis_t m = {
        .angle = {.pulse_0 = (uint16_t)w->pulse_halfus[0], .tilt = w->tilt_turn_q32},
        .bias = {.pulse_1 = (uint16_t)w->pulse_halfus[1], .bias = w->bias_turnps_q28},
        .rate = {.rate = w->rate_corrected_turnps_q28},
        .measured = {.tilt_measured = w->tilt_measured_turn_q32},
        .command = {.command = w->pid.command_q22},
    };

    send_axis(r, mask, &m, step_low);
}

static void send_balancer(routing_t *r, uint32_t mask, const balancer_words_t *w, uint8_t step_low) {
    const message_drive_t drive = {.duty = (int16_t)w->duty_q15, .velocity = w->wheel.velocity_mps_q26};
    const axis_t m = {
        .angle = {.tilt = w->tilt_turn_q32},
        .bias = {.bias = w->bias_turnps_q28},
        .rate = {.rate = w->rate_corrected_turnps_q28},
        .measured = {.tilt_measured = w->tilt_measured_turn_q32},
        .command = {.command = w->pid.command_q22},
    };

    send_axis(r, mask, &m, step_low);
    if ((mask & FRAME_DRIVE) != 0) {
        routing_telemetry(r, message_drive_pack(&drive), step_low);
    }
}

static void send_phone(routing_t *r, uint32_t mask, const phone_words_t *w, uint8_t step_low) {
    if ((mask & FRAME_ANGLE) != 0) {
        const message_angle_t m = {.tilt = w->pitch_turn_q32};
        routing_telemetry(r, message_angle_pack(&m), step_low);
    }
    if ((mask & FRAME_BIAS) != 0) {
        const message_bias_t m = {.bias = w->pitch_bias_turnps_q28};
        routing_telemetry(r, message_bias_pack(&m), step_low);
    }
    if ((mask & FRAME_ROLL) != 0) {
        const message_roll_t m = {.flags = (uint16_t)w->flags, .roll = w->roll_turn_q32};
        routing_telemetry(r, message_roll_pack(&m), step_low);
    }
    if ((mask & FRAME_ROLL_BIAS) != 0) {
        const message_roll_bias_t m = {.bias = w->roll_bias_turnps_q28};
        routing_telemetry(r, message_roll_bias_pack(&m), step_low);
    }
}

/* A rate as the frames carry it: turn/s Q13, within 4 turn/s. */
static int16_t rate_q13(int32_t rate_turnps_q28) {
    return (int16_t)clamp_i32(asr32(rate_turnps_q28, 15), INT16_MIN, INT16_MAX);
}

static void send_turntable(routing_t *r, uint32_t mask, const turntable_words_t *w, uint8_t step_low) {
    const quaternion_t *const q = &w->attitude;
    const int32_t *const rate = w->rate_corrected_turnps_q28;
    const message_attitude_w_t scalar = {.flags = (uint16_t)w->flags, .w = q->w};
    const message_attitude_x_t x = {.rate_x = rate_q13(rate[0]), .x = q->x};
    const message_attitude_y_t y = {.rate_y = rate_q13(rate[1]), .y = q->y};
    const message_attitude_z_t z = {.rate_z = rate_q13(rate[2]), .z = q->z};

    if ((mask & FRAME_ATTITUDE_W) != 0) {
        routing_telemetry(r, message_attitude_w_pack(&scalar), step_low);
    }
    if ((mask & FRAME_ATTITUDE_X) != 0) {
        routing_telemetry(r, message_attitude_x_pack(&x), step_low);
    }
    if ((mask & FRAME_ATTITUDE_Y) != 0) {
        routing_telemetry(r, message_attitude_y_pack(&y), step_low);
    }
    if ((mask & FRAME_ATTITUDE_Z) != 0) {
        routing_telemetry(r, message_attitude_z_pack(&z), step_low);
    }
}

/* The frames that the system's words have names in. */
static void send_named(routing_t *r, uint32_t mask, const control_t *c, const control_params_t *params,
                       uint8_t step_low) {
    switch (params->system) {
    case CONTROL_BALANCER:
        send_balancer(r, mask, &c->balancer.words, step_low);
        break;
    case CONTROL_PHONE:
        send_phone(r, mask, &c->phone.words, step_low);
        break;
    case CONTROL_TURNTABLE:
        send_turntable(r, mask, &c->turntable.words, step_low);
        break;
    default:
        send_quad(r, mask, &c->quad.words, step_low);
    }
}

/* The first selected word at or after a place in the record; CONTROL_RECORD_WORDS_MAX where there is none. A
 * bank of 32 words in which none is selected costs one look. */
static uint8_t next_selected(const telemetry_t *t, unsigned index) {
    while (index < CONTROL_RECORD_WORDS_MAX) {
        const uint32_t rest = t->words_mask[index / 32U] >> (index % 32U);

        if (rest != 0) {
            return (uint8_t)(index + 31U - clz32(rest & (0U - rest)));
        }
        index = (index / 32U + 1U) * 32U;
    }
    return CONTROL_RECORD_WORDS_MAX;
}

void telemetry_send_words(telemetry_t *t, routing_t *r, const void *record, link_t pacer) {
    const uint8_t *const words = record;

    for (;; t->word_next++) {
        t->word_next = next_selected(t, t->word_next);
        if (t->word_next == CONTROL_RECORD_WORDS_MAX ||
            (pacer != LINK_NONE && !outbox_long_fits(r->link[pacer].outbox))) {
            return;
        }
        message_word_t m = {.index = t->word_next};
        memcpy(&m.value, words + 4U * m.index, sizeof m.value);
        routing_telemetry(r, message_word_pack(&m), t->step_low);
    }
}

bool telemetry_has_room(const telemetry_t *t, const routing_t *r, link_t link) {
    return t->word_next == CONTROL_RECORD_WORDS_MAX &&
           outbox_telemetry_fits(r->link[link].outbox, t->selected);
}

static void send_step(telemetry_t *t, routing_t *r, const message_step_t *m, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        outbox_t *const outbox = r->link[i].outbox;
        const uint16_t dropped = outbox->dropped; /* before this STEP, which may be dropped itself */

        if (r->link[i].open) {
            outbox_telemetry(outbox, message_step_pack(m), flags_on(t, r, i, flags));
            t->dropped_told[i] = dropped;
        }
    }
}

void telemetry_step(telemetry_t *t, routing_t *r, const control_t *c, const control_params_t *params,
                    uint16_t step, uint8_t flags) {
    const void *const words = control_words(c);
    const message_step_t m = {.step = step, .digest = digest_crc32(words, control_words_bytes(params))};

    t->digest[RUN_SLOT(step)] = m.digest;
    t->step_low = (uint8_t)(step & E2E_COUNTER_MASK);
    t->word_next = 0;
    send_step(t, r, &m, flags);
    send_raw(t, r, step, words);
    send_named(r, t->frames_mask, c, params, t->step_low);
}

void telemetry_repeat_step(const telemetry_t *t, routing_t *r, const request_t *q, uint16_t step,
                           uint8_t flags) {
    const message_step_t m = {.step = step, .digest = t->digest[RUN_SLOT(step)]};

    routing_reply(r, q, message_step_pack(&m), flags_on(t, r, q->link, flags));
}
