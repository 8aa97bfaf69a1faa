/* The shipped loop on the native port, at the mercy of two hosts, of its wires and of its power: the input is
 * a program of what happens and of the time between. After every millisecond the board has to keep what
 * docs/reference/protocol.md promises; at the end, with nothing misbehaving any more, it has to answer over
 * both links.
 *
 * Input: operations of one byte (op_t, modulo OPS) and their arguments; missing bytes are 0. */
#include "core/digest.h"
#include "generated/params.h"
#include "session_hosts.h"
#include <stddef.h>

#define ROW(field)     ((uint16_t)(offsetof(params_t, field) / 4U))
#define NEUTRAL_HALFUS 2000U    /* of the default table */
#define BUDGET_US      1500000U /* of the operations */
#define SETTLE_US      200000U  /* for what is under way, and for a bootloader that was asked for */
#define SAFE_US        50000U   /* from the last keep-alive that counted to neutral outputs */
#define LIFE_US        40000U   /* of a value for the keep-alive */
#define ASKER          0x10000U /* of these hosts, in CHALLENGE */
#define RUN_IDLE_MODE  0U       /* STATUS.mode */
#define RUN_LOCK_MODE  1U
#define REST_GYRO      1676U /* counts at rest */
#define REST_ACCEL_Y   2048U
#define REST_ACCEL_Z   3041U

typedef enum {
    OP_TEXT,      /* count modulo 32, bytes: over the UART as they are */
    OP_FRAME,     /* link, message, byte 1, half, word: a sealed frame from the table of the host's */
    OP_RAW_FRAME, /* id, dlc, 8 bytes: on CAN as they are */
    OP_WAIT,      /* units of 0.25 ms */
    OP_LONG_WAIT, /* units of 5 ms */
    OP_HELLO,     /* link; bit 1: of another version */
    OP_VERB,      /* link, verb, flags: CHALLENGE, then EXECUTE or RUN_BEGIN with the nonce that came */
    OP_ANSWER,  /* which links answer values for the keep-alive from now on, bit by bit; bit 2: twice; bit 3:
                   old ones again and again */
    OP_REPLAY,  /* link: the last value, whether it was answered or not */
    OP_SAMPLES, /* link, count modulo 16, difference: samples about rest, and the setpoint before them */
    OP_UPLOAD,  /* link, index, kind and value: DEFAULTS, PARAM_SET, PARAM_COMMIT with the right CRC */
    OP_SWITCH,  /* the arm switch */
    OP_WIRE,    /* wire, value: a way to misbehave */
    OP_POWER,   /* strap and crystal: off and on again */
    OP_CUT,     /* operation of the flash, way */
    OP_DISARM,  /* link */
    OPS
} op_t;

static struct {
    const uint8_t *at, *end;
} input;

static uint8_t next(void) {
    return input.at < input.end ? *input.at++ : 0U;
}

static uint32_t next_bytes(unsigned count) {
    uint32_t value = 0;
    for (unsigned i = 0; i < count; i++) {
        value |= (uint32_t)next() << (8U * i);
    }
    return value;
}

/* ---- what holds at any time ---- */

static void check(void) {
    const bool pulses_rest = (native.pulse_halfus[0] == 0U || native.pulse_halfus[0] == NEUTRAL_HALFUS) &&
                             (native.pulse_halfus[1] == 0U || native.pulse_halfus[1] == NEUTRAL_HALFUS);
    const bool rests = pulses_rest && native.duty_q15 == 0;
    const uint64_t now_us = native_now_us();

    if (native.resets != host.resets) {
        host.resets = native.resets;
        host.was_armed = false;
    }
    host.was_armed = host.was_armed || native.armed != 0U;
    REQUIRE(rests || native.armed != 0U);
    REQUIRE(native.bridge_on == 0U || native.armed != 0U);
    REQUIRE(native.state == NATIVE_RUNNING || (rests && native.bridge_on == 0U));
    if (native.arm_switch != 0U) {
        host.host_since_us = now_us;
    }
    /* Who armed is a host: its last answer is no older than it may wait on its way and then hold. */
    const uint32_t line_us = native.uart_in_byte_ns != 0U || native.turn_us != 0U ? LIFE_US : 1000U;
    if (now_us - host.host_since_us > SAFE_US) {
        REQUIRE(rests || now_us - host.counted_us <= SAFE_US + line_us);
        REQUIRE(native.armed == 0U || native.turn_us != 0U || now_us - host.counted_us <= SAFE_US + line_us);
    }
}

static void pass_slices(uint32_t us) {
    for (uint32_t passed = 0; passed < us; passed += 1000U) {
        if ((host.answers & 8U) != 0U) {
            say(host.value_link, MESSAGE_KEEPALIVE_ID, 0, host.arming, host.used);
        }
        native_run(us - passed < 1000U ? us - passed : 1000U);
        listen();
        check();
    }
}

static void pass(uint32_t us) {
    const uint32_t left_us = BUDGET_US - host.spent_us;
    const uint32_t spend_us = us < left_us ? us : left_us;
    host.spent_us += spend_us;
    pass_slices(spend_us);
}

/* ---- operations ---- */

static void power(uint32_t strap, bool crystal) {
    native_power_off();
    native.strap = strap;
    native.no_crystal = !crystal;
    slcan_rx_init(&host.parser);
    native_power_on();
    host.was_armed = false;
    host.resets = native.resets;
    host.cause = 0;
    check();
}

static void verb(unsigned link, uint16_t number, uint8_t flags) {
    say(link, MESSAGE_CHALLENGE_ID, 0, number, ASKER);
    pass(1000U);
    if (number >= MESSAGE_RUN_BEGIN_RUN_LOCKSTEP) {
        say(link, MESSAGE_RUN_BEGIN_ID, (uint8_t)(flags << 4), number, host.nonce[link] ^ ASKER);
    } else {
        say(link, MESSAGE_EXECUTE_ID, 0, number, host.nonce[link] ^ ASKER);
    }
    pass(1000U);
}

static void upload(unsigned link, uint16_t index, uint8_t kind, uint32_t value) {
    params_t table;
    params_default(&table);
    verb(link, MESSAGE_EXECUTE_VERB_DEFAULTS, 0);
    /* Neutral and bit rate stay as this target knows them. */
    if (index != ROW(control.esc.neutral_halfus) && index != ROW(can_bitrate_kbit)) {
        const uint32_t word = (kind & 1U) != 0U ? params_word(&table, index) + value - 0x80U : value;
        say(link, MESSAGE_PARAM_SET_ID, 0, index, word);
        if (params_in_range(index, word)) {
            params_set_word(&table, index, word);
        }
    }
    pass(500U);
    say(link, MESSAGE_PARAM_COMMIT_ID, 1, PARAMS_COUNT, params_crc32(&table));
    pass(1000U);
}

static void samples(unsigned link, unsigned count, uint8_t difference) {
    say(link, MESSAGE_SETPOINT_ID, (uint8_t)(host.tag << 4), (uint16_t)(host.step & 0xFFFFU),
        (uint32_t)difference << 20);
    for (unsigned i = 0; i < count; i++) {
        const uint16_t gyro = (uint16_t)(REST_GYRO + difference % 16U);
        say(link, MESSAGE_SAMPLE_A_ID, (uint8_t)((host.step & 15U) | (host.step >> 4 & 3U) << 4), gyro,
            REST_ACCEL_Y | REST_ACCEL_Z << 16);
        host.step++;
    }
}

static void wire(uint8_t which, uint8_t value) {
    switch (which % 18U) {
    case 0:
        native.bridge_break = value & 1U;
        break;
    case 1:
        native.hall_lost = value & 1U;
        break;
    case 2:
        native.uart_in_byte_ns = (value & 1U) * 10851U;
        break;
    case 3:
        native.uart_out_byte_ns = value == 255U ? NATIVE_NEVER : (value & 1U) * 10851U;
        break;
    case 4:
        native.can_kbit = (value & 1U) != 0U ? 500U : 0U;
        break;
    case 5:
        native.can_frame_ns = (value & 1U) * 230000U;
        break;
    case 6:
        native.faults = 1U << value % 16U;
        break;
    case 7:
        native.railed = value;
        break;
    case 8:
        native.stuck = value;
        break;
    case 9:
        native.gyro = value % 7U;
        break;
    case 10:
        native.accel = value % 7U;
        break;
    case 11:
        native.adc_dead = value & 1U;
        break;
    case 12:
        native.uart_damaged = value;
        break;
    case 13:
        native.can_dead = value & 1U;
        break;
    case 14:
        native.hangs = value & 1U;
        break;
    case 15:
        native.turn_us = value * 32U;
        break;
    case 16:
        native.flash_refuses = value & 1U;
        break;
    default:
        native.raw[value % BOARD_RAW_MAX] = (int32_t)(next_bytes(2U) & 0xFFFU);
    }
}

static void step(void) {
    uint8_t bytes[32];
    size_t count;
    unsigned link;
    can_frame_t f = {0};
    uint16_t index;
    uint8_t kind;

    switch ((op_t)(next() % OPS)) {
    case OP_TEXT:
        count = next() % sizeof bytes;
        for (size_t i = 0; i < count; i++) {
            bytes[i] = next();
        }
        (void)native_uart_send(bytes, count);
        break;
    case OP_FRAME:
        link = next() & 1U;
        index = messages_from_host[next() % MESSAGES_FROM_HOST];
        kind = next();
        say(link, index, kind, (uint16_t)(next_bytes(2U) & 0xFFFFU), next_bytes(4U));
        break;
    case OP_RAW_FRAME:
        f.id = (uint16_t)(next_bytes(2U) & CAN_ID_MAX);
        f.dlc = next() % 9U;
        for (unsigned i = 0; i < f.dlc; i++) {
            f.data[i] = next();
        }
        send(1U, &f);
        break;
    case OP_WAIT:
        pass(250U * next());
        break;
    case OP_LONG_WAIT:
        pass(5000U * next());
        break;
    case OP_HELLO:
        kind = next();
        link = kind & 1U;
        say(link, MESSAGE_HELLO_ID, 0, MESSAGES_PROTOCOL_VERSION + (kind >> 1 & 1U), MESSAGES_DBC_HASH);
        break;
    case OP_VERB:
        link = next() & 1U;
        index = next() % 20U;
        verb(link, index, next() & 15U);
        break;
    case OP_ANSWER:
        host.answers = next();
        break;
    case OP_REPLAY:
        answer(next() & 1U);
        break;
    case OP_SAMPLES:
        link = next() & 1U;
        kind = next() % 16U;
        samples(link, kind, next());
        break;
    case OP_UPLOAD:
        link = next() & 1U;
        index = next() % PARAMS_COUNT;
        kind = next();
        upload(link, index, kind, next_bytes((kind & 1U) != 0U ? 1U : 2U));
        break;
    case OP_SWITCH:
        native.arm_switch = next() & 1U;
        break;
    case OP_WIRE:
        kind = next();
        wire(kind, next());
        break;
    case OP_POWER:
        kind = next();
        power(kind % BOARD_PINS_UNKNOWN, kind < 128U);
        break;
    case OP_CUT:
        native.flash_cut = next();
        native.flash_cut_way = next() % 4U;
        break;
    case OP_DISARM:
        say(next() & 1U, MESSAGE_DISARM_ID, 0, 0, 0);
        pass(250U);
        break;
    default:
        break;
    }
}

/* ---- the end: all is well again ---- */

static void restore(void) {
    native.bridge_break = native.hall_lost = native.faults = native.railed = native.stuck = 0U;
    native.gyro = native.accel = native.adc_dead = native.uart_damaged = native.can_dead = 0U;
    native.hangs = native.turn_us = native.flash_refuses = native.flash_cut = native.arm_switch = 0U;
    native.uart_in_byte_ns = native.uart_out_byte_ns = native.can_frame_ns = 0U;
    native.can_kbit = 500U;
    host.answers = 0U;
    say_text("\r"); /* ends a line that was begun */
    pass_slices(SETTLE_US);
    if (native.state != NATIVE_RUNNING) {
        power(BOARD_PINS_STANDARD, true);
    }
}

/* A host connects over the UART: each answer comes within this time. */
static void check_uart(void) {
    const uint32_t version = host.version_count, identity = host.identity_end[0], status = host.status_count,
                   events = host.events_count;
    say_text("C\rO\rV\r");
    pass_slices(50000U);
    REQUIRE(host.version_count == version + 1U);
    say(0, MESSAGE_HELLO_ID, 0, MESSAGES_PROTOCOL_VERSION, MESSAGES_DBC_HASH);
    pass_slices(130000U);
    REQUIRE(host.identity_end[0] == identity + 1U);
    REQUIRE(host.status_count > status && host.events_count > events);
    REQUIRE(native.armed == 0U);
    REQUIRE(host.cause != 0U || !host.was_armed);
}

/* The same on CAN, as soon as the controller is back on the bus: after a second of rest at the latest. */
static void check_can(void) {
    const uint32_t identity = host.identity_end[1];
    for (unsigned i = 0; i < 15U && host.identity_end[1] == identity; i++) {
        say(1, MESSAGE_HELLO_ID, 0, MESSAGES_PROTOCOL_VERSION, MESSAGES_DBC_HASH);
        pass_slices(100000U);
    }
    REQUIRE(host.identity_end[1] > identity);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    memset(&host, 0, sizeof host);
    input.at = data;
    input.end = data + (size < INPUT_MAX ? size : INPUT_MAX);
    native_defaults();
    native_set_clock_us(size > 0 ? (uint32_t)next() << 24 : 0U); /* the clock wraps at 2^32 */
    power(BOARD_PINS_STANDARD, true);
    while (input.at < input.end && host.spent_us < BUDGET_US) {
        step();
    }
    restore();
    check_uart();
    if (native.no_crystal == 0U) {
        check_can();
    }
    native_power_off();
    return 0;
}
