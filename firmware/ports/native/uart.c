/* UART: the bytes on the lines, and the board's buffers, with the sizes of ports/stm32f103/uart.c. A line
 * without delay waits while the board's buffer is full; on a line with a rate the board loses what it has no
 * room for. */
#include "line_queue.h"
#include "port.h"
#include <string.h>

#define LINE_BYTES 65536U /* on the line, or not yet fetched by the host */
#define RX_BYTES   1024U
#define TX_BYTES   256U
#define ERRORS_MAX 255U

static uint8_t line_in_bytes[LINE_BYTES], line_out_bytes[LINE_BYTES], rx_bytes[RX_BYTES], tx_bytes[TX_BYTES];
static line_queue_t line_in, line_out, rx, tx;

static struct {
    uint64_t in_ns, out_ns; /* when the byte under way has passed */
    uint32_t errors;
    bool tx_refused;
} uart;

void uart_unplug(void) {
    line_in = line_out = (line_queue_t){0};
}

void uart_reset(void) {
    memset(&uart, 0, sizeof uart);
    rx = tx = (line_queue_t){0};
}

uint32_t uart_faults(void) {
    const uint32_t all = uart.errors + receiver_errors(), errors = all < ERRORS_MAX ? all : ERRORS_MAX;
    return (errors > 0U ? BOARD_FAULT_UART_OVERRUN : 0U) | errors << BOARD_FAULT_UART_COUNT_SHIFT;
}

static bool listens(void) {
    return native.state == NATIVE_RUNNING && native.strap != BOARD_PINS_UNKNOWN;
}

static void lose_byte(void) {
    uart.errors += uart.errors < ERRORS_MAX ? 1U : 0U;
    port_wake();
}

static void receive_byte(uint8_t byte) {
    if (native.uart_damaged > 0U) {
        native.uart_damaged--;
        lose_byte();
    } else if (line_queue_used(&rx) == RX_BYTES) {
        lose_byte();
    } else {
        rx_bytes[rx.in++ % RX_BYTES] = byte;
    }
}

static void advance_in(void) {
    while (line_queue_used(&line_in) > 0U && uart.in_ns <= port_now_ns()) {
        if (native.uart_in_byte_ns == 0U && line_queue_used(&rx) == RX_BYTES) {
            return;
        }
        receive_byte(line_in_bytes[line_in.out++ % LINE_BYTES]);
        uart.in_ns += native.uart_in_byte_ns;
        if (line_queue_used(&line_in) == 0U || line_queue_used(&rx) >= RX_BYTES / 2U) {
            port_wake(); /* an idle line, or half a ring */
        }
    }
}

static void advance_out(void) {
    if (native.uart_out_byte_ns == NATIVE_NEVER) {
        uart.out_ns = port_now_ns();
        return;
    }
    while (line_queue_used(&tx) > 0U && uart.out_ns <= port_now_ns()) {
        if (line_queue_used(&line_out) <
            LINE_BYTES) { /* else the host does not fetch them: the byte is lost */
            line_out_bytes[line_out.in++ % LINE_BYTES] = tx_bytes[tx.out % TX_BYTES];
        }
        tx.out++;
        uart.out_ns += native.uart_out_byte_ns;
    }
    if (uart.tx_refused && line_queue_used(&tx) == 0U) {
        uart.tx_refused = false;
        port_wake();
    }
}

size_t native_uart_send(const uint8_t *bytes, size_t count) {
    size_t taken = 0U;
    if (line_queue_used(&line_in) == 0U) {
        uart.in_ns = port_now_ns() + native.uart_in_byte_ns;
    }
    while (taken < count && line_queue_used(&line_in) < LINE_BYTES && listens()) {
        line_in_bytes[line_in.in++ % LINE_BYTES] = bytes[taken++];
    }
    uart_advance();
    return listens() ? taken : count;
}

size_t native_uart_receive(uint8_t *bytes, size_t room) {
    size_t count = 0U;
    while (count < room && line_queue_used(&line_out) > 0U) {
        bytes[count++] = line_out_bytes[line_out.out++ % LINE_BYTES];
    }
    return count;
}

size_t board_uart_read(uint8_t *bytes, size_t room) {
    size_t count = 0U;
    while (count < room && line_queue_used(&rx) > 0U) {
        bytes[count++] = rx_bytes[rx.out++ % RX_BYTES];
    }
    if (count > 0U && line_queue_used(&rx) + line_queue_used(&line_in) > 0U) {
        port_wake();
    }
    return count;
}

size_t board_uart_room(void) {
    advance_out();
    const size_t room = TX_BYTES - line_queue_used(&tx);
    uart.tx_refused = room == 0U;
    return room;
}

size_t board_uart_write(const uint8_t *bytes, size_t count) {
    size_t accepted = 0U;
    if (line_queue_used(&tx) == 0U) {
        uart.out_ns = port_now_ns() + native.uart_out_byte_ns;
    }
    while (accepted < count && line_queue_used(&tx) < TX_BYTES) {
        tx_bytes[tx.in++ % TX_BYTES] = bytes[accepted++];
    }
    return accepted;
}

bool uart_waits(void) {
    return line_queue_used(&rx) > 0U;
}

void uart_advance(void) {
    if (listens()) {
        advance_in();
        advance_out();
    }
}

uint64_t uart_next_ns(void) {
    uint64_t next_ns = UINT64_MAX;
    if (line_queue_used(&line_in) > 0U && listens()) {
        const uint32_t room = RX_BYTES / 2U;
        const uint32_t count = line_queue_used(&line_in) < room ? line_queue_used(&line_in) : room;
        next_ns = line_queue_passed_ns(uart.in_ns, count, native.uart_in_byte_ns);
    }
    if (uart.tx_refused && native.uart_out_byte_ns != NATIVE_NEVER && line_queue_used(&tx) > 0U) {
        const uint64_t sent_ns =
            line_queue_passed_ns(uart.out_ns, line_queue_used(&tx), native.uart_out_byte_ns);
        next_ns = sent_ns < next_ns ? sent_ns : next_ns;
    }
    return next_ns;
}
