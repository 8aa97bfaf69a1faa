/* Framing, protection and queue: known answers, round trips, and anything at all into the parser and the
 * session. The sanitizers watch; what the session says is tested from Python. */
#include "check.h"
#include "generated/messages.h"
#include "link/requests.h"
#include "link/stepping.h"
#include <stdio.h>
#include <string.h>

static can_frame_t random_frame(void) {
    can_frame_t f = {.id = (uint16_t)(check_random() & CAN_ID_MAX)};

    for (unsigned i = 2; i < 8; i++) {
        f.data[i] = (uint8_t)(check_random() & 0xFFU);
    }
    e2e_seal(&f, (uint8_t)(check_random() & 15U), (uint8_t)(check_random() & 15U));
    return f;
}

static void check_framing(void) {
    slcan_rx_t rx;

    slcan_rx_init(&rx);
    for (unsigned n = 0; n < 20000; n++) {
        const can_frame_t sent = random_frame();
        uint8_t text[SLCAN_FRAME_CHARS];
        can_frame_t received = {0};
        slcan_event_t event = SLCAN_NOTHING;

        CHECK(e2e_check(&sent));
        CHECK(slcan_encode(&sent, text) == SLCAN_FRAME_CHARS);
        for (unsigned i = 0; i < sizeof text; i++) {
            CHECK(event == SLCAN_NOTHING);
            event = slcan_rx_push_byte(&rx, text[i], &received);
        }
        CHECK(event == SLCAN_FRAME && memcmp(&received, &sent, sizeof sent) == 0);
        /* Noise up to a CR, and the next frame is received again. */
        for (unsigned i = check_random() % 64U; i > 0; i--) {
            (void)slcan_rx_push_byte(&rx, (uint8_t)(check_random() & 0xFFU), &received);
        }
        (void)slcan_rx_push_byte(&rx, SLCAN_CR, &received);
    }
}

/* Every length and every byte value as printf writes them. */
static void check_text(void) {
    for (unsigned n = 0; n < 256U * 9U; n++) {
        can_frame_t f = {.id = (uint16_t)(check_random() & CAN_ID_MAX), .dlc = (uint8_t)(n % 9U)};
        char expected[SLCAN_FRAME_CHARS + 1U];
        uint8_t text[SLCAN_FRAME_CHARS];
        int length = snprintf(expected, sizeof expected, "t%03X%u", f.id, f.dlc);

        for (unsigned i = 0; i < f.dlc; i++) {
            f.data[i] = (uint8_t)(n / 9U + 37U * i);
            length += snprintf(expected + length, sizeof expected - (size_t)length, "%02X", f.data[i]);
        }
        expected[length++] = SLCAN_CR;
        CHECK(slcan_encode(&f, text) == (size_t)length && memcmp(text, expected, (size_t)length) == 0);
    }
}

/* Characters taken many at once, as far as that goes, leave the parser as characters taken one by one do. */
static void check_text_at_once(void) {
    static const char pieces[][12] = {"t", "123", "8", "0011aaFF", "\r", "\a", "V\r", " ~", "\x7f", "\x1f"};
    slcan_rx_t singly, at_once;

    slcan_rx_init(&singly);
    slcan_rx_init(&at_once);
    for (unsigned n = 0; n < 20000; n++) {
        uint8_t bytes[64];
        size_t count = 0;
        while (count + sizeof pieces[0] < sizeof bytes) {
            const char *const piece = pieces[check_random() % (sizeof pieces / sizeof pieces[0])];
            memcpy(&bytes[count], piece, strlen(piece));
            count += strlen(piece);
        }
        for (size_t i = 0; i < count; i++) {
            const size_t taken = slcan_rx_push_text(&at_once, &bytes[i], count - i);
            can_frame_t a = {0}, b = {0};
            for (const size_t end = i + taken; i < end; i++) {
                CHECK(slcan_rx_push_byte(&singly, bytes[i], &a) == SLCAN_NOTHING);
            }
            CHECK(memcmp(&singly, &at_once, sizeof singly) == 0);
            if (i < count) {
                CHECK(slcan_rx_push_byte(&singly, bytes[i], &a) ==
                      slcan_rx_push_byte(&at_once, bytes[i], &b));
                CHECK(memcmp(&a, &b, sizeof a) == 0 && memcmp(&singly, &at_once, sizeof singly) == 0);
            }
        }
    }
}

/* Against the definition, bit by bit, over what the CRC covers: identifier, length, bytes 7 to 1; least
 * significant bits first, the polynomial mirrored. */
static void check_crc(void) {
    can_frame_t f = {.id = 0x0131U, .dlc = 8, .data = {0, '3', '4', '5', '6', '7', '8', '9'}};
    uint8_t crc = 0xFFU;
    const uint8_t covered[] = {0x01, 0x31, 8, '9', '8', '7', '6', '5', '4', '3'};

    for (unsigned i = 0; i < sizeof covered; i++) {
        crc ^= covered[i];
        for (unsigned bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc & 1U) != 0 ? ((unsigned)crc >> 1) ^ 0xF4U : (unsigned)crc >> 1);
        }
    }
    crc ^= 0xFFU;
    CHECK(e2e_crc8(&f) == crc);
    f.data[0] = e2e_crc8(&f);
    CHECK(e2e_check(&f));
    f.dlc = 7;
    CHECK(!e2e_check(&f));
}

/* Frames and characters come out in the order they went in, round and round, cut anywhere, and nothing is
 * dropped by halves. */
static void check_queue(void) {
    static outbox_t box;
    static uint8_t expected[1U << 16], received[1U << 16];
    uint32_t in = 0, out = 0;
    can_frame_t frame;

    outbox_init(&box);
    while (in < sizeof expected - 64U) {
        uint8_t text[64];
        const size_t count = check_random() % (OUTBOX_TEXT + 1U);
        const size_t taken = outbox_pop_text(&box, text, check_random() % sizeof text);

        memcpy(&received[out], text, taken);
        out += (uint32_t)taken;
        if (outbox_room(&box) == 0) {
            continue;
        }
        if (check_random() % 2U == 0) {
            frame = random_frame();
            outbox_reply(&box, frame, 3);
            e2e_seal(&frame, (box.counter[OUTBOX_SLOT(frame.id)] - 1U) & E2E_COUNTER_MASK, 3);
            in += (uint32_t)slcan_encode(&frame, &expected[in]);
        } else if (count > 0) {
            memset(text, (int)('0' + in % 10U), count);
            outbox_put(&box, text, count);
            memcpy(&expected[in], text, count);
            in += (uint32_t)count;
        }
    }
    out += (uint32_t)outbox_pop_text(&box, &received[out], sizeof received - out);
    CHECK(out == in && memcmp(expected, received, in) == 0);
    CHECK(outbox_room(&box) == OUTBOX_ENTRIES);

    for (unsigned n = 0; n < 200; n++) {
        outbox_telemetry(&box, random_frame(), 0);
        CHECK(outbox_room(&box) >= OUTBOX_RESERVE);
    }
    CHECK(box.dropped == 200U - (OUTBOX_ENTRIES - OUTBOX_RESERVE));
    for (unsigned n = 0; n < 500; n++) { /* beyond the last entry: nothing is overwritten */
        outbox_put(&box, (const uint8_t *)"\r", 1);
        outbox_reply(&box, random_frame(), 0);
    }
    CHECK(outbox_room(&box) == 0);
    for (unsigned n = 0; n < OUTBOX_ENTRIES - OUTBOX_RESERVE; n++) {
        CHECK(outbox_pop_frame(&box, &frame) && e2e_check(&frame));
    }
    outbox_clear(&box);
    CHECK(outbox_room(&box) == OUTBOX_ENTRIES && !outbox_pop_frame(&box, &frame));
}

/* Memory is not checked here. */
void board_parameters_seal(void) {}

/* Turns of the loop with frames of every identifier and with noise coming in. */
static void check_session(void) {
    static const board_identity_t board = {.unique_id = {1, 2, 3}};
    static const uint16_t runs[] = {MESSAGE_RUN_BEGIN_RUN_LOCKSTEP, MESSAGE_RUN_BEGIN_RUN_REALTIME_INJECTED,
                                    MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE};
    static session_t session;
    static session_buffers_t buffers;
    static control_t control;
    static params_t params;
    uint32_t now_us = 0xFFF00000U; /* the clock wraps on the way */
    uint32_t steps = 0;

    params_default(&params);
    CHECK(control_params_valid(&params.control));
    session_init(&session, &buffers, &board, &control, &params, &(store_report_t){.found = STORE_NOTHING});
    requests_receive(&session, (const uint8_t *)"O\r", 2, now_us);
    session.routing.link[LINK_UART].greeted = true;
    for (unsigned n = 0; n < 200000; n++) {
        uint8_t bytes[SLCAN_FRAME_CHARS];
        int16_t raw[PLUMB_RAW_MAX] = {0};
        int32_t setpoint = 0;
        bool begun = false;
        can_frame_t f = random_frame();
        size_t count = sizeof bytes;

        f.id = (uint16_t)(f.id & 0x23FU);
        e2e_seal(&f, (uint8_t)(n & 15U), (uint8_t)(check_random() & 3U));
        (void)slcan_encode(&f, bytes);
        if (check_random() % 8U == 0) {
            bytes[check_random() % sizeof bytes] = (uint8_t)(check_random() & 0xFFU);
        }
        if (requests_room(&session) < count) {
            count = requests_room(&session);
        }
        requests_receive(&session, bytes, count, now_us);
        if (n % 1000U == 0) { /* as if a host had begun a run */
            const uint16_t run = runs[n / 1000U % 3U];
            const message_nonce_t m = {
                .verb = run,
                .nonce = nonce_issue(&session.nonce[LINK_UART], &session.random, run, 0, now_us)};
            can_frame_t begin = message_nonce_pack(&m);

            begin.id = MESSAGE_RUN_BEGIN_ID;
            requests_handle(&session, &(request_t){.frame = &begin, .link = LINK_UART, .now_us = now_us});
            begun = true;
        }
        session_poll(&session, now_us);
        const session_orders_t orders = session_take_orders(&session, now_us);
        CHECK(orders.begun || !begun);
        CHECK(!orders.armed && !orders.driving); /* no EXECUTE: its nonce would have to be guessed */
        if (orders.mode != RUN_IDLE && session_take_inputs(&session, raw, &setpoint)) {
            control_step(&control, &params.control, raw, setpoint);
            session_stepped(&session);
            steps++;
        }
        (void)session_transmit(&buffers, bytes, check_random() % sizeof bytes);
        now_us += 100U;
    }
    CHECK(steps > 10000);
    CHECK(session.routing.link[LINK_UART].outbox->dropped > 0);
    CHECK(session.routing.link[LINK_UART].rejected > 10000);
}

int main(void) {
    check_framing();
    check_text();
    check_text_at_once();
    check_crc();
    check_queue();
    check_session();
    return check_failures != 0;
}
