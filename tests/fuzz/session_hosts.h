/* Two hosts at the mercy of the fuzzer's input: what they have received, and what every frame and line of the
 * board has to keep. Included once, by fuzz_session.c. */
#ifndef PLUMB_TESTS_SESSION_HOSTS_H
#define PLUMB_TESTS_SESSION_HOSTS_H

#include "generated/messages.h"
#include "input.h"
#include "link/slcan.h"
#include "ports/native/native.h"
#include <string.h>

static struct {
    slcan_rx_t parser;
    uint32_t spent_us;
    uint32_t nonce[2], value, answers, tag, step;
    uint16_t arming; /* number that came with value */
    unsigned value_link;
    bool value_answered;
    uint32_t used;          /* the last value that was answered */
    uint64_t counted_us;    /* the newest one that was answered for the first time, or the ACK of ARM */
    uint64_t host_since_us; /* the arm switch is open, and was seen so */
    uint16_t mode, cause;
    uint32_t status_count, version_count, identity_end[2], events_count;
    bool was_armed; /* since the last start */
    uint32_t resets;
} host;

/* ---- to the board ---- */

static void send(unsigned link, const can_frame_t *f) {
    if (link != 0U) {
        native_frame_t frame = {.id = f->id, .dlc = f->dlc};
        memcpy(frame.data, f->data, sizeof frame.data);
        (void)native_can_send(&frame);
    } else {
        uint8_t text[SLCAN_FRAME_CHARS];
        (void)native_uart_send(text, slcan_encode(f, text));
    }
}

static void say(unsigned link, uint16_t id, uint8_t second, uint16_t half, uint32_t word) {
    can_frame_t f = {.id = id, .dlc = CAN_FRAME_DLC};
    f.data[2] = (uint8_t)(half & 0xFFU);
    f.data[3] = (uint8_t)(half >> 8);
    for (unsigned i = 0; i < 4U; i++) {
        f.data[4U + i] = (uint8_t)(word >> (8U * i) & 0xFFU);
    }
    e2e_seal(&f, second & E2E_COUNTER_MASK, second >> 4);
    send(link, &f);
}

static void say_text(const char *text) {
    (void)native_uart_send((const uint8_t *)text, strlen(text));
}

/* ---- from the board ---- */

static uint16_t half_at(const can_frame_t *f, unsigned at) {
    return (uint16_t)(f->data[at] | f->data[at + 1U] << 8);
}

static uint32_t word_of(const can_frame_t *f) {
    return half_at(f, 4U) | (uint32_t)half_at(f, 6U) << 16;
}

/* Only the first answer to a value, over the link it came over, may count. */
static void answer(unsigned link) {
    if (link == host.value_link && !host.value_answered) {
        host.value_answered = true;
        host.used = host.value;
        host.counted_us = native_now_us();
    }
    say(link, MESSAGE_KEEPALIVE_ID, 0, host.arming, host.value);
}

static void on_value(unsigned link, uint16_t arming, uint32_t value) {
    host.arming = arming;
    host.value = value;
    host.value_link = link;
    host.value_answered = false;
    for (unsigned i = 0; (host.answers >> link & 1U) != 0U && i <= (host.answers >> 2 & 1U); i++) {
        answer(link);
    }
}

static void on_ack(const can_frame_t *f) {
    if (half_at(f, 2U) == MESSAGE_EXECUTE_ID && word_of(f) > 0xFFFFU) { /* of ARM: else a verb */
        host.counted_us = native_now_us();
    } else if (half_at(f, 2U) == MESSAGE_RUN_BEGIN_ID) {
        host.tag = word_of(f) >> 16 & 15U;
        host.step = 0;
    }
}

static void on_frame(unsigned link, const can_frame_t *f) {
    REQUIRE(e2e_check(f));
    switch (f->id) {
    case MESSAGE_NONCE_ID:
        host.nonce[link] = word_of(f);
        break;
    case MESSAGE_KEEPALIVE_VALUE_ID:
        on_value(link, half_at(f, 2U), word_of(f));
        break;
    case MESSAGE_ACK_ID:
        on_ack(f);
        break;
    case MESSAGE_STATUS_ID: {
        const unsigned flags = e2e_flags(f);
        host.mode = half_at(f, 2U);
        host.status_count++;
        REQUIRE(host.mode <= 2U);
        REQUIRE((flags & MESSAGE_STATUS_ARMED) == 0U || host.mode == 2U); /* armed: in real time */
        REQUIRE((flags & MESSAGE_STATUS_LIVE) == 0U || host.mode == 2U);
        break;
    }
    case MESSAGE_EVENTS_ID:
        host.cause = half_at(f, 6U);
        host.events_count++;
        break;
    case MESSAGE_IDENTITY_ID:
        if (half_at(f, 2U) == MESSAGE_IDENTITY_ITEM_END) {
            host.identity_end[link]++;
        }
        break;
    default:
        REQUIRE(f->id >= MESSAGE_STEP_ID); /* none that a host sends */
    }
}

/* A line of the board is one of the table of commands: a frame, V, N, or nothing before CR. BEL stands alone.
 */
static void on_byte(uint8_t byte) {
    static const uint8_t version[] = {'V', '0', '1', '0' + MESSAGES_PROTOCOL_VERSION / 10U,
                                      '0' + MESSAGES_PROTOCOL_VERSION % 10U};
    can_frame_t f;
    if (byte == SLCAN_BEL) {
        REQUIRE(host.parser.length == 0 || host.parser.complete != 0);
    }
    switch (slcan_rx_push_byte(&host.parser, byte, &f)) {
    case SLCAN_FRAME:
        REQUIRE(f.dlc == CAN_FRAME_DLC);
        on_frame(0, &f);
        break;
    case SLCAN_COMMAND:
        if (host.parser.line[0] == 'V') {
            REQUIRE(host.parser.length == 5U && memcmp(host.parser.line, version, sizeof version) == 0);
            host.version_count++;
        } else {
            REQUIRE(host.parser.line[0] == 'N' && host.parser.length == 5U);
        }
        break;
    default:
        REQUIRE(host.parser.bad == 0);
    }
}

static void listen(void) {
    uint8_t bytes[256];
    size_t count;
    while ((count = native_uart_receive(bytes, sizeof bytes)) > 0U) {
        for (size_t i = 0; i < count; i++) {
            on_byte(bytes[i]);
        }
    }
    native_frame_t frame;
    while (native_can_receive(&frame)) {
        can_frame_t f = {.id = (uint16_t)frame.id, .dlc = (uint8_t)frame.dlc};
        REQUIRE(frame.dlc == CAN_FRAME_DLC && frame.id <= CAN_ID_MAX);
        memcpy(f.data, frame.data, sizeof f.data);
        on_frame(1, &f);
    }
}

#endif
