/* UART and CAN: the bytes and frames on the lines, and the board's buffers, with the sizes and limits of
 * ports/stm32f103/uart.c and bxcan.c. A line without delay waits while the board's buffer is full; on a line
 * with a rate the board loses what it has no room for. */
#include "port.h"
#include <string.h>

#define LINE_BYTES    65536U /* on the line, or not yet fetched by the host */
#define RX_BYTES      1024U
#define TX_BYTES      256U
#define ERRORS_MAX    255U
#define LINE_FRAMES   1024U
#define RX_FRAMES     16U
#define MAILBOXES     3U
#define REST_MIN_MS   10U
#define REST_MAX_MS   1000U
#define GIVE_UP_MS    500U
#define NO_ACK        3U /* ISO 11898-1, as board_can_health_t has it */
#define BIT_ERROR     4U
#define ERROR_PASSIVE 128U

/* ---- queues; free-running counts ---- */

typedef struct {
    uint32_t in, out;
} queue_t;

static uint32_t used(const queue_t *q) {
    return q->in - q->out;
}

static uint8_t line_in_bytes[LINE_BYTES], line_out_bytes[LINE_BYTES], rx_bytes[RX_BYTES], tx_bytes[TX_BYTES];
static queue_t line_in, line_out, rx, tx;
static can_frame_t bus_in_frames[LINE_FRAMES], bus_out_frames[LINE_FRAMES], rx_frames[RX_FRAMES],
    mailbox[MAILBOXES];
static queue_t bus_in, bus_out, can_rx, can_tx;

typedef enum { CAN_OFF, CAN_JOINING, CAN_ON, CAN_RESTING } can_state_t;

static struct {
    uint64_t in_ns, out_ns; /* when the byte under way has passed */
    uint64_t bus_in_ns, bus_out_ns;
    uint32_t errors;
    bool tx_refused, overrun;
    can_state_t can;
    uint32_t kbit, since_ms, sent_ms, rest_ms;
    const uint16_t *ids;
    size_t id_count;
    board_can_health_t health;
} links;

void links_unplug(void) {
    line_in = line_out = bus_in = bus_out = (queue_t){0};
}

void links_reset(void) {
    memset(&links, 0, sizeof links);
    rx = tx = can_rx = can_tx = (queue_t){0};
    links.health.bus_off = true;
    links.rest_ms = REST_MIN_MS;
    links.can = native.no_crystal != 0U ? CAN_OFF : CAN_JOINING;
    links.since_ms = port_now_ms();
}

uint32_t links_faults(void) {
    const uint32_t all = links.errors + receiver_errors(), errors = all < ERRORS_MAX ? all : ERRORS_MAX;
    return (errors > 0U ? BOARD_FAULT_UART_OVERRUN : 0U) | errors << BOARD_FAULT_UART_COUNT_SHIFT |
           (links.overrun ? BOARD_FAULT_CAN_OVERRUN : 0U);
}

/* ---- UART ---- */

static bool listens(void) {
    return native.state == NATIVE_RUNNING && native.strap != BOARD_PINS_UNKNOWN;
}

static void lose_byte(void) {
    links.errors += links.errors < ERRORS_MAX ? 1U : 0U;
    port_wake();
}

static void receive_byte(uint8_t byte) {
    if (native.uart_damaged > 0U) {
        native.uart_damaged--;
        lose_byte();
    } else if (used(&rx) == RX_BYTES) {
        lose_byte();
    } else {
        rx_bytes[rx.in++ % RX_BYTES] = byte;
    }
}

static void advance_uart_in(void) {
    while (used(&line_in) > 0U && links.in_ns <= port_now_ns()) {
        if (native.uart_in_byte_ns == 0U && used(&rx) == RX_BYTES) {
            return;
        }
        receive_byte(line_in_bytes[line_in.out++ % LINE_BYTES]);
        links.in_ns += native.uart_in_byte_ns;
        if (used(&line_in) == 0U || used(&rx) >= RX_BYTES / 2U) {
            port_wake(); /* an idle line, or half a ring */
        }
    }
}

static void advance_uart_out(void) {
    if (native.uart_out_byte_ns == NATIVE_NEVER) {
        links.out_ns = port_now_ns();
        return;
    }
    while (used(&tx) > 0U && links.out_ns <= port_now_ns()) {
        if (used(&line_out) < LINE_BYTES) { /* else the host does not fetch them: the byte is lost */
            line_out_bytes[line_out.in++ % LINE_BYTES] = tx_bytes[tx.out % TX_BYTES];
        }
        tx.out++;
        links.out_ns += native.uart_out_byte_ns;
    }
    if (links.tx_refused && used(&tx) == 0U) {
        links.tx_refused = false;
        port_wake();
    }
}

size_t native_uart_send(const uint8_t *bytes, size_t count) {
    size_t taken = 0U;
    if (used(&line_in) == 0U) {
        links.in_ns = port_now_ns() + native.uart_in_byte_ns;
    }
    while (taken < count && used(&line_in) < LINE_BYTES && listens()) {
        line_in_bytes[line_in.in++ % LINE_BYTES] = bytes[taken++];
    }
    links_advance();
    return listens() ? taken : count;
}

size_t native_uart_receive(uint8_t *bytes, size_t room) {
    size_t count = 0U;
    while (count < room && used(&line_out) > 0U) {
        bytes[count++] = line_out_bytes[line_out.out++ % LINE_BYTES];
    }
    return count;
}

size_t board_uart_read(uint8_t *bytes, size_t room) {
    size_t count = 0U;
    while (count < room && used(&rx) > 0U) {
        bytes[count++] = rx_bytes[rx.out++ % RX_BYTES];
    }
    if (count > 0U && used(&rx) + used(&line_in) > 0U) {
        port_wake();
    }
    return count;
}

size_t board_uart_room(void) {
    advance_uart_out();
    const size_t room = TX_BYTES - used(&tx);
    links.tx_refused = room == 0U;
    return room;
}

size_t board_uart_write(const uint8_t *bytes, size_t count) {
    size_t accepted = 0U;
    if (used(&tx) == 0U) {
        links.out_ns = port_now_ns() + native.uart_out_byte_ns;
    }
    while (accepted < count && used(&tx) < TX_BYTES) {
        tx_bytes[tx.in++ % TX_BYTES] = bytes[accepted++];
    }
    return accepted;
}

/* ---- CAN ---- */

static bool accepted(uint16_t id) {
    for (size_t i = 0U; i < links.id_count; i++) {
        if (links.ids[i] == id) {
            return true;
        }
    }
    return false;
}

/* True when frames can pass: both ends are connected, at the same rate. */
static bool bus_works(void) {
    return links.can == CAN_ON && native.can_kbit == links.kbit && native.can_dead == 0U;
}

static void advance_can_in(void) {
    while (used(&bus_in) > 0U && links.bus_in_ns <= port_now_ns()) {
        if (native.can_frame_ns == 0U && used(&can_rx) == RX_FRAMES) {
            return;
        }
        const can_frame_t frame = bus_in_frames[bus_in.out++ % LINE_FRAMES];
        links.bus_in_ns += native.can_frame_ns;
        if (!bus_works() || !accepted(frame.id)) {
            continue;
        }
        if (used(&can_rx) == RX_FRAMES) {
            links.overrun = true;
        } else {
            rx_frames[can_rx.in++ % RX_FRAMES] = frame;
        }
        port_wake();
    }
}

static void advance_can_out(void) {
    while (used(&can_tx) > 0U && bus_works() && links.bus_out_ns <= port_now_ns()) {
        if (used(&bus_out) < LINE_FRAMES) {
            bus_out_frames[bus_out.in++ % LINE_FRAMES] = mailbox[can_tx.out % MAILBOXES];
        }
        can_tx.out++;
        links.bus_out_ns += native.can_frame_ns;
        links.sent_ms = port_now_ms();
        links.health.transmit_errors = 0U;
        port_wake();
    }
}

bool native_can_send(const native_frame_t *frame) {
    if (used(&bus_in) == LINE_FRAMES) {
        return false;
    }
    if (used(&bus_in) == 0U) {
        links.bus_in_ns = port_now_ns() + native.can_frame_ns;
    }
    can_frame_t *const to = &bus_in_frames[bus_in.in++ % LINE_FRAMES];
    *to = (can_frame_t){.id = (uint16_t)frame->id, .dlc = (uint8_t)frame->dlc};
    memcpy(to->data, frame->data, sizeof to->data);
    if (native.state == NATIVE_RUNNING) {
        links_advance();
    }
    return true;
}

bool native_can_receive(native_frame_t *frame) {
    if (used(&bus_out) == 0U) {
        return false;
    }
    const can_frame_t *const from = &bus_out_frames[bus_out.out++ % LINE_FRAMES];
    *frame = (native_frame_t){.id = from->id, .dlc = from->dlc};
    memcpy(frame->data, from->data, sizeof frame->data);
    return true;
}

static void enter(can_state_t state) {
    links.can = state;
    links.since_ms = port_now_ms();
}

static void look_after(uint32_t now_ms) {
    if (native.can_dead != 0U) {
        links.health.last_error = BIT_ERROR;
        links.health.bus_offs++;
        native.bus_offs++;
        enter(CAN_RESTING);
        return;
    }
    if (now_ms - links.since_ms >= REST_MAX_MS) {
        links.rest_ms = REST_MIN_MS; /* on the bus for long enough: the next pause is short again */
    }
    if (used(&can_tx) > 0U && !bus_works()) {
        links.health.transmit_errors = ERROR_PASSIVE; /* alone on the bus the counter stops here */
        links.health.last_error = NO_ACK;
        if (now_ms - links.sent_ms >= GIVE_UP_MS) {
            can_tx = (queue_t){0};
        }
    }
}

void board_can_join(uint32_t kbit, const uint16_t *ids, size_t count) {
    links.ids = ids;
    links.id_count = count;
    if (links.can == CAN_OFF) {
        return;
    }
    const uint32_t now_ms = port_now_ms();
    if (kbit != links.kbit) {
        links.kbit = kbit;
        enter(CAN_JOINING);
    }
    switch (links.can) {
    case CAN_JOINING:
        links.sent_ms = now_ms;
        enter(CAN_ON);
        port_wake();
        break;
    case CAN_ON:
        look_after(now_ms);
        break;
    default:
        if (now_ms - links.since_ms >= links.rest_ms) {
            links.rest_ms = 2U * links.rest_ms < REST_MAX_MS ? 2U * links.rest_ms : REST_MAX_MS;
            enter(CAN_JOINING);
        }
    }
    links.health.bus_off = links.can != CAN_ON;
}

bool board_can_read(can_frame_t *frame) {
    advance_can_in();
    if (used(&can_rx) == 0U) {
        return false;
    }
    *frame = rx_frames[can_rx.out++ % RX_FRAMES];
    if (used(&can_rx) + used(&bus_in) > 0U) {
        port_wake();
    }
    return true;
}

bool board_can_room(void) {
    advance_can_out();
    return links.can == CAN_ON && used(&can_tx) < MAILBOXES;
}

void board_can_send(const can_frame_t *frame) {
    if (used(&can_tx) == 0U) {
        links.sent_ms = port_now_ms();
        links.bus_out_ns = port_now_ns() + native.can_frame_ns;
    }
    mailbox[can_tx.in++ % MAILBOXES] = *frame;
}

const board_can_health_t *board_can_health(void) {
    return &links.health;
}

/* ---- both ---- */

bool links_wait(void) {
    advance_can_in();
    return used(&rx) > 0U || used(&can_rx) > 0U;
}

/* ---- time ---- */

void links_advance(void) {
    if (listens()) {
        advance_uart_in();
        advance_uart_out();
    }
    advance_can_in();
    advance_can_out();
}

/* Time at which `count` bytes or frames have passed, the first of them at `first_ns`. */
static uint64_t passed_ns(uint64_t first_ns, uint32_t count, uint32_t each_ns) {
    return first_ns + (uint64_t)(count - 1U) * each_ns;
}

uint64_t links_next_ns(void) {
    uint64_t next_ns = UINT64_MAX;
    if (used(&line_in) > 0U && listens()) {
        const uint32_t room = RX_BYTES / 2U;
        const uint32_t count = used(&line_in) < room ? used(&line_in) : room;
        next_ns = passed_ns(links.in_ns, count, native.uart_in_byte_ns);
    }
    if (links.tx_refused && native.uart_out_byte_ns != NATIVE_NEVER && used(&tx) > 0U) {
        const uint64_t sent_ns = passed_ns(links.out_ns, used(&tx), native.uart_out_byte_ns);
        next_ns = sent_ns < next_ns ? sent_ns : next_ns;
    }
    if (used(&bus_in) > 0U && links.bus_in_ns < next_ns) {
        next_ns = links.bus_in_ns;
    }
    if (used(&can_tx) > 0U && bus_works() && links.bus_out_ns < next_ns) {
        next_ns = links.bus_out_ns;
    }
    return next_ns;
}
