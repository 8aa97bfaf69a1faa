/* A host of the native board, over UART or over CAN: it asks and receives, saves parameters, begins a run and
 * arms. For the tests of the main loop. */
#ifndef PLUMB_TESTS_LOOP_HOST_H
#define PLUMB_TESTS_LOOP_HOST_H

#include "app/board.h"
#include "check.h"
#include "generated/messages.h"
#include "generated/params.h"
#include "link/slcan.h"
#include "ports/native/native.h"
#include "systems/control.h"
#include <stddef.h>
#include <string.h>

#define ASKER          1U /* the number of this host in CHALLENGE */
#define ROW(field)     ((uint16_t)(offsetof(params_t, field) / 4U))
#define SYSTEM_ROW     ROW(control.system)
#define FRAMES_MAX     4096U
#define READY_US       1500000U
#define SETTLE_US      60000U
#define NEUTRAL_HALFUS 2000U

typedef enum { OVER_UART, OVER_CAN, WAYS } way_t;

static way_t way;
static uint8_t counter;
static slcan_rx_t parser;
static can_frame_t received[FRAMES_MAX];
static size_t received_count;
static bool keeps_alive;

static inline void put(const can_frame_t *f) {
    if (way == OVER_CAN) {
        native_frame_t frame = {.id = f->id, .dlc = f->dlc};
        memcpy(frame.data, f->data, sizeof frame.data);
        (void)native_can_send(&frame);
    } else {
        uint8_t text[SLCAN_FRAME_CHARS];
        (void)native_uart_send(text, slcan_encode(f, text));
    }
}

static inline void say(uint16_t id, uint16_t half, uint32_t word) {
    can_frame_t f = {.id = id, .dlc = CAN_FRAME_DLC};
    f.data[2] = (uint8_t)(half & 0xFFU);
    f.data[3] = (uint8_t)(half >> 8);
    for (unsigned i = 0; i < 4U; i++) {
        f.data[4U + i] = (uint8_t)(word >> (8U * i) & 0xFFU);
    }
    e2e_seal(&f, counter++ & E2E_COUNTER_MASK, 0);
    put(&f);
}

static inline uint16_t half_of(const can_frame_t *f) {
    return (uint16_t)(f->data[2] | f->data[3] << 8);
}

static inline uint32_t word_of(const can_frame_t *f) {
    return f->data[4] | (uint32_t)f->data[5] << 8 | (uint32_t)f->data[6] << 16 | (uint32_t)f->data[7] << 24;
}

static inline void note(const can_frame_t *f) {
    if (!e2e_check(f)) {
        CHECK(!"a frame of the board is damaged");
        return;
    }
    if (received_count < FRAMES_MAX) {
        received[received_count++] = *f;
    }
    if (keeps_alive && f->id == MESSAGE_KEEPALIVE_VALUE_ID) {
        say(MESSAGE_KEEPALIVE_ID, half_of(f), word_of(f));
    }
}

static inline void listen(void) {
    uint8_t bytes[256];
    size_t count;
    while ((count = native_uart_receive(bytes, sizeof bytes)) > 0U) {
        for (size_t i = 0; i < count; i++) {
            can_frame_t f;
            if (slcan_rx_push_byte(&parser, bytes[i], &f) == SLCAN_FRAME && way == OVER_UART) {
                note(&f);
            }
        }
    }
    native_frame_t frame;
    while (native_can_receive(&frame)) {
        can_frame_t f = {.id = (uint16_t)frame.id, .dlc = (uint8_t)frame.dlc};
        memcpy(f.data, frame.data, sizeof f.data);
        if (way == OVER_CAN) {
            note(&f);
        }
    }
}

static inline void pass(uint32_t us) {
    for (uint32_t passed = 0; passed < us; passed += 1000U) {
        native_run(us - passed < 1000U ? us - passed : 1000U);
        listen();
    }
}

/* The last frame with this identifier since `say`; NULL: none. */
static inline const can_frame_t *last(uint16_t id) {
    for (size_t i = received_count; i > 0; i--) {
        if (received[i - 1U].id == id) {
            return &received[i - 1U];
        }
    }
    return NULL;
}

static inline size_t count_of(uint16_t id) {
    size_t count = 0;
    for (size_t i = 0; i < received_count; i++) {
        count += received[i].id == id;
    }
    return count;
}

static inline uint32_t ask(uint16_t id, uint16_t half, uint32_t word, uint16_t answer) {
    received_count = 0;
    say(id, half, word);
    pass(5000);
    const can_frame_t *const f = last(answer);
    CHECK(f != NULL);
    return f != NULL ? word_of(f) : 0U;
}

static inline void open_link(void) {
    counter = 0;
    slcan_rx_init(&parser);
    pass(2000); /* CAN joins its bus */
    if (way == OVER_UART) {
        (void)native_uart_send((const uint8_t *)"\rC\rO\r", 5);
        pass(2000);
    }
    (void)ask(MESSAGE_HELLO_ID, MESSAGES_PROTOCOL_VERSION, MESSAGES_DBC_HASH, MESSAGE_IDENTITY_ID);
    pass(50000);
}

static inline bool execute(uint16_t verb) {
    const uint32_t nonce = ask(MESSAGE_CHALLENGE_ID, verb, ASKER, MESSAGE_NONCE_ID);
    received_count = 0;
    say(MESSAGE_EXECUTE_ID, verb, nonce ^ ASKER);
    pass(5000);
    return last(MESSAGE_ACK_ID) != NULL && last(MESSAGE_NACK_ID) == NULL;
}

static inline void begin(uint16_t run) {
    const uint32_t nonce = ask(MESSAGE_CHALLENGE_ID, run, 0, MESSAGE_NONCE_ID);
    (void)ask(MESSAGE_RUN_BEGIN_ID, run, nonce, MESSAGE_ACK_ID);
}

/* The default table as this system, on the pins that drive it. */
static inline params_t table(uint32_t system) {
    params_t p;
    params_default(&p);
    p.control.system = system;
    p.pins =
        control_system(&p.control)->output == CONTROL_OUTPUT_BRIDGE ? BOARD_PINS_BRIDGE : BOARD_PINS_STANDARD;
    p.arm_hold_ms = 0;
    p.period_us = 4000;
    return p;
}

static inline void upload(const params_t *p) {
    params_t defaults;
    params_default(&defaults);
    for (uint16_t i = 0; i < PARAMS_COUNT; i++) {
        if (params_word(p, i) != params_word(&defaults, i)) {
            (void)ask(MESSAGE_PARAM_SET_ID, i, params_word(p, i), MESSAGE_PARAM_STAGED_ID);
        }
    }
    CHECK(ask(MESSAGE_PARAM_COMMIT_ID, PARAMS_COUNT, params_crc32(p), MESSAGE_ACK_ID) == params_crc32(p));
}

/* A board that has saved its parameters as this system and was switched on with its strap. */
static inline void system_board(uint32_t system) {
    const params_t p = table(system);
    keeps_alive = false;
    native_defaults();
    native.strap = BOARD_PINS_STANDARD;
    native_power_on();
    open_link();
    upload(&p);
    CHECK(execute(MESSAGE_EXECUTE_VERB_SAVE));
    native_power_off();
    native.strap = p.pins;
    native_power_on();
    open_link();
    CHECK(ask(MESSAGE_PARAM_GET_ID, SYSTEM_ROW, 0, MESSAGE_PARAM_VALUE_ID) == system);
}

static inline const control_system_t *declared(uint32_t system) {
    const params_t p = table(system);
    return control_system(&p.control);
}

static inline bool safe(void) {
    const bool resting = native.pulse_halfus[0] == NEUTRAL_HALFUS && native.pulse_halfus[1] == NEUTRAL_HALFUS;
    const bool undriven = native.pulse_halfus[0] == 0U && native.pulse_halfus[1] == 0U;
    return (resting || undriven) && native.bridge_on == 0U;
}

/* Time in us, at most limit_us, until the board says this about a word of a frame; limit_us: it does not. */
static inline uint32_t reported_after_us(uint16_t id, unsigned byte, uint8_t bit, uint32_t limit_us) {
    uint32_t us = 0;
    for (received_count = 0; us < limit_us; us += 1000U) {
        const can_frame_t *const f = last(id);
        if (f != NULL && (f->data[byte] >> bit & 1U) != 0U) {
            break;
        }
        pass(1000);
    }
    return us;
}

/* The moment at which the periodic report is longest away. */
static inline void wait_for_report(void) {
    pass(50000); /* earlier changes have been reported */
    received_count = 0;
    for (unsigned i = 0; i < 200U && last(MESSAGE_STATUS_ID) == NULL; i++) {
        pass(1000);
    }
    CHECK(last(MESSAGE_STATUS_ID) != NULL);
    pass(5000);
}

/* Armed over this link, kept alive, the outputs away from neutral. */
static inline void drive(void) {
    keeps_alive = true;
    begin(MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
    pass(READY_US);
    CHECK(execute(MESSAGE_EXECUTE_VERB_ARM));
    pass(SETTLE_US);
    CHECK(native.armed == 1U && !safe());
}

#endif
