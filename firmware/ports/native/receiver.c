/* The lines of the receiver: the bytes on one, edges on the other, and the board's ring, with the size of
 * ports/stm32f103/receiver_uart.c. Nothing on it wakes the loop, so what has passed is looked at when the
 * loop reads. */
#include "app/board_receiver.h"
#include "port.h"

#define LINE_BYTES 4096U
#define RX_BYTES   256U
#define ERRORS_MAX 255U
#define LINE_EDGES 1024U
#define EDGES      32U

static uint8_t line[LINE_BYTES], ring[RX_BYTES];
static uint32_t line_in, line_out, ring_in, ring_out; /* free-running counts */
static uint64_t byte_ns;                              /* when the byte under way has passed */
static uint32_t errors;
/* Edges of the pulse train: when each comes, in us of the board, and the ring of
 * ports/stm32f103/ppm_capture.c. */
static uint64_t pulses_us[LINE_EDGES];
static uint32_t pulses_in, pulses_out;
static uint16_t edges[EDGES];
static uint32_t edges_in, edges_out;

void receiver_reset(void) {
    ring_in = ring_out = errors = 0U;
    edges_in = edges_out = 0U;
}

void receiver_unplug(void) {
    line_in = line_out = 0U;
    pulses_in = pulses_out = 0U;
}

uint32_t receiver_errors(void) {
    return errors;
}

size_t native_receiver_send(const uint8_t *bytes, size_t count) {
    size_t taken = 0U;
    if (line_in == line_out) {
        byte_ns = port_now_ns() + native.receiver_byte_ns;
    }
    while (taken < count && line_in - line_out < LINE_BYTES) {
        line[line_in++ % LINE_BYTES] = bytes[taken++];
    }
    return taken;
}

/* A line without delay waits while the ring is full. */
static void advance(void) {
    while (line_in != line_out && byte_ns <= port_now_ns()) {
        const bool full = ring_in - ring_out == RX_BYTES;
        if (full && native.receiver_byte_ns == 0U) {
            return;
        }
        const uint8_t byte = line[line_out++ % LINE_BYTES];
        byte_ns += native.receiver_byte_ns;
        if (!port_vehicle()) {
            continue;
        }
        if (full) {
            errors += errors < ERRORS_MAX ? 1U : 0U;
        } else {
            ring[ring_in++ % RX_BYTES] = byte;
        }
    }
}

size_t board_receiver_read(uint8_t *bytes, size_t room) {
    size_t count = 0U;
    advance();
    while (count < room && ring_out != ring_in) {
        bytes[count++] = ring[ring_out++ % RX_BYTES];
    }
    return count;
}

size_t native_receiver_edge(uint64_t at_us) {
    const bool room = pulses_in - pulses_out < LINE_EDGES;
    if (room) {
        pulses_us[pulses_in++ % LINE_EDGES] = at_us;
    }
    return room ? 1U : 0U;
}

size_t board_receiver_edges(uint16_t *stamps_us, size_t room) {
    size_t count = 0U;
    while (pulses_in != pulses_out && pulses_us[pulses_out % LINE_EDGES] * NS_PER_US <= port_now_ns()) {
        const uint64_t at_us = pulses_us[pulses_out++ % LINE_EDGES];
        if (board_pins_pulse_train(port.identity.pins) && edges_in - edges_out < EDGES) {
            edges[edges_in++ % EDGES] = (uint16_t)at_us;
        }
    }
    while (count < room && edges_out != edges_in) {
        stamps_us[count++] = edges[edges_out++ % EDGES];
    }
    return count;
}
