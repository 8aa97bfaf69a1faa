/* CAN: the frames on the bus, the board's buffers, and how it joins the bus and leaves it, with the sizes and
 * limits of ports/stm32f103/bxcan.c. A bus without delay waits while the board's buffer is full; on a bus
 * with a rate the board loses what it has no room for. */
#include "line_queue.h"
#include "port.h"
#include <string.h>

#define LINE_FRAMES   1024U
#define RX_FRAMES     16U
#define MAILBOXES     3U
#define REST_MIN_MS   10U
#define REST_MAX_MS   1000U
#define GIVE_UP_MS    500U
#define NO_ACK        3U /* ISO 11898-1, as board_can_health_t has it */
#define BIT_ERROR     4U
#define ERROR_PASSIVE 128U

static can_frame_t bus_in_frames[LINE_FRAMES], bus_out_frames[LINE_FRAMES], rx_frames[RX_FRAMES],
    mailbox[MAILBOXES];
static line_queue_t bus_in, bus_out, rx, tx;

typedef enum { CAN_OFF, CAN_JOINING, CAN_ON, CAN_RESTING } can_state_t;

static struct {
    uint64_t in_ns, out_ns; /* when the frame under way has passed */
    bool overrun;
    can_state_t state;
    uint32_t kbit, since_ms, sent_ms, rest_ms;
    const uint16_t *ids;
    size_t id_count;
    board_can_health_t health;
} bus;

void can_unplug(void) {
    bus_in = bus_out = (line_queue_t){0};
}

void can_reset(void) {
    memset(&bus, 0, sizeof bus);
    rx = tx = (line_queue_t){0};
    bus.health.bus_off = true;
    bus.rest_ms = REST_MIN_MS;
    bus.state = native.no_crystal != 0U ? CAN_OFF : CAN_JOINING;
    bus.since_ms = port_now_ms();
}

uint32_t can_faults(void) {
    return bus.overrun ? BOARD_FAULT_CAN_OVERRUN : 0U;
}

static bool accepted(uint16_t id) {
    for (size_t i = 0U; i < bus.id_count; i++) {
        if (bus.ids[i] == id) {
            return true;
        }
    }
    return false;
}

/* True when frames can pass: both ends are connected, at the same rate. */
static bool bus_works(void) {
    return bus.state == CAN_ON && native.can_kbit == bus.kbit && native.can_dead == 0U;
}

static void advance_in(void) {
    while (line_queue_used(&bus_in) > 0U && bus.in_ns <= port_now_ns()) {
        if (native.can_frame_ns == 0U && line_queue_used(&rx) == RX_FRAMES) {
            return;
        }
        const can_frame_t frame = bus_in_frames[bus_in.out++ % LINE_FRAMES];
        bus.in_ns += native.can_frame_ns;
        if (!bus_works() || !accepted(frame.id)) {
            continue;
        }
        if (line_queue_used(&rx) == RX_FRAMES) {
            bus.overrun = true;
        } else {
            rx_frames[rx.in++ % RX_FRAMES] = frame;
        }
        port_wake();
    }
}

static void advance_out(void) {
    while (line_queue_used(&tx) > 0U && bus_works() && bus.out_ns <= port_now_ns()) {
        if (line_queue_used(&bus_out) < LINE_FRAMES) {
            bus_out_frames[bus_out.in++ % LINE_FRAMES] = mailbox[tx.out % MAILBOXES];
        }
        tx.out++;
        bus.out_ns += native.can_frame_ns;
        bus.sent_ms = port_now_ms();
        bus.health.transmit_errors = 0U;
        port_wake();
    }
}

bool native_can_send(const native_frame_t *frame) {
    if (line_queue_used(&bus_in) == LINE_FRAMES) {
        return false;
    }
    if (line_queue_used(&bus_in) == 0U) {
        bus.in_ns = port_now_ns() + native.can_frame_ns;
    }
    can_frame_t *const to = &bus_in_frames[bus_in.in++ % LINE_FRAMES];
    *to = (can_frame_t){.id = (uint16_t)frame->id, .dlc = (uint8_t)frame->dlc};
    memcpy(to->data, frame->data, sizeof to->data);
    if (native.state == NATIVE_RUNNING) {
        can_advance();
    }
    return true;
}

bool native_can_receive(native_frame_t *frame) {
    if (line_queue_used(&bus_out) == 0U) {
        return false;
    }
    const can_frame_t *const from = &bus_out_frames[bus_out.out++ % LINE_FRAMES];
    *frame = (native_frame_t){.id = from->id, .dlc = from->dlc};
    memcpy(frame->data, from->data, sizeof frame->data);
    return true;
}

static void enter(can_state_t state) {
    bus.state = state;
    bus.since_ms = port_now_ms();
}

static void look_after(uint32_t now_ms) {
    if (native.can_dead != 0U) {
        bus.health.last_error = BIT_ERROR;
        bus.health.bus_offs++;
        native.bus_offs++;
        enter(CAN_RESTING);
        return;
    }
    if (now_ms - bus.since_ms >= REST_MAX_MS) {
        bus.rest_ms = REST_MIN_MS; /* on the bus for long enough: the next pause is short again */
    }
    if (line_queue_used(&tx) > 0U && !bus_works()) {
        bus.health.transmit_errors = ERROR_PASSIVE; /* alone on the bus the counter stops here */
        bus.health.last_error = NO_ACK;
        if (now_ms - bus.sent_ms >= GIVE_UP_MS) {
            tx = (line_queue_t){0};
        }
    }
}

void board_can_join(uint32_t kbit, const uint16_t *ids, size_t count) {
    bus.ids = ids;
    bus.id_count = count;
    if (bus.state == CAN_OFF) {
        return;
    }
    const uint32_t now_ms = port_now_ms();
    if (kbit != bus.kbit) {
        bus.kbit = kbit;
        enter(CAN_JOINING);
    }
    switch (bus.state) {
    case CAN_JOINING:
        bus.sent_ms = now_ms;
        enter(CAN_ON);
        port_wake();
        break;
    case CAN_ON:
        look_after(now_ms);
        break;
    default:
        if (now_ms - bus.since_ms >= bus.rest_ms) {
            bus.rest_ms = 2U * bus.rest_ms < REST_MAX_MS ? 2U * bus.rest_ms : REST_MAX_MS;
            enter(CAN_JOINING);
        }
    }
    bus.health.bus_off = bus.state != CAN_ON;
}

bool board_can_read(can_frame_t *frame) {
    advance_in();
    if (line_queue_used(&rx) == 0U) {
        return false;
    }
    *frame = rx_frames[rx.out++ % RX_FRAMES];
    if (line_queue_used(&rx) + line_queue_used(&bus_in) > 0U) {
        port_wake();
    }
    return true;
}

bool board_can_room(void) {
    advance_out();
    return bus.state == CAN_ON && line_queue_used(&tx) < MAILBOXES;
}

void board_can_send(const can_frame_t *frame) {
    if (line_queue_used(&tx) == 0U) {
        bus.sent_ms = port_now_ms();
        bus.out_ns = port_now_ns() + native.can_frame_ns;
    }
    mailbox[tx.in++ % MAILBOXES] = *frame;
}

const board_can_health_t *board_can_health(void) {
    return &bus.health;
}

bool can_waits(void) {
    advance_in();
    return line_queue_used(&rx) > 0U;
}

void can_advance(void) {
    advance_in();
    advance_out();
}

uint64_t can_next_ns(void) {
    uint64_t next_ns = line_queue_used(&bus_in) > 0U ? bus.in_ns : UINT64_MAX;
    if (line_queue_used(&tx) > 0U && bus_works() && bus.out_ns < next_ns) {
        next_ns = bus.out_ns;
    }
    return next_ns;
}
