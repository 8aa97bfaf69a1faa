#include "commands.h"
#include "generated/messages.h"

#define HARDWARE_VERSION "01"

/* Outbox entries that received bytes may need. The shortest line with an answer of its own, "V\r", takes two
 * bytes an entry. On top come at once: CR and one frame for the end of a line that began earlier, a CR that
 * follows it, a pending SETPOINT_USED, and the urgent frames. */
#define BYTES_PER_ENTRY 2U
#define ENTRIES_AT_ONCE (4U + OUTBOX_URGENT)

static void put_text(routing_t *routing, const uint8_t *text, size_t count) {
    outbox_put(routing->link[LINK_UART].outbox, text, count);
}

static void put_char(routing_t *routing, uint8_t character) {
    put_text(routing, &character, 1);
}

/* "N" and four digits. */
static void put_serial_number(routing_t *routing, unsigned number) {
    static const char hex[] = "0123456789ABCDEF";
    uint8_t text[6] = {'N', 0, 0, 0, 0, SLCAN_CR};

    for (unsigned i = 0; i < 4; i++) {
        text[1 + i] = (uint8_t)hex[(number >> (12U - 4U * i)) & 15U];
    }
    put_text(routing, text, sizeof text);
}

static commands_event_t on_command(const commands_t *c, routing_t *routing) {
    static const uint8_t version[] = {'V',
                                      HARDWARE_VERSION[0],
                                      HARDWARE_VERSION[1],
                                      '0' + MESSAGES_PROTOCOL_VERSION / 10U,
                                      '0' + MESSAGES_PROTOCOL_VERSION % 10U,
                                      SLCAN_CR};
    const uint8_t first = c->rx.line[0];
    const bool alone = c->rx.length == 1;

    switch (alone || first == 'S' || first == 's' ? first : 0) {
    case 'O':
    case 'L':
    case 'C':
        routing_open(routing, LINK_UART, first != 'C', first == 'L');
        put_char(routing, SLCAN_CR);
        return first == 'O' ? COMMANDS_NOTHING : COMMANDS_CLOSED;
    case 'S': /* bit rates: accepted without effect, as this link drives no CAN bus */
    case 's':
        put_char(routing, SLCAN_CR);
        break;
    case 'V':
        put_text(routing, version, sizeof version);
        break;
    case 'N':
        put_serial_number(routing, c->serial_number);
        break;
    default:
        put_char(routing, SLCAN_BEL);
    }
    return COMMANDS_NOTHING;
}

void commands_init(commands_t *c, const uint32_t unique_id[3]) {
    const uint32_t mixed = unique_id[0] ^ unique_id[1] ^ unique_id[2];

    slcan_rx_init(&c->rx);
    c->serial_number = (uint16_t)(((mixed >> 16) ^ mixed) & 0xFFFFU);
}

size_t commands_room(const routing_t *routing) {
    const size_t room = outbox_room(routing->link[LINK_UART].outbox);

    return room > ENTRIES_AT_ONCE ? (room - ENTRIES_AT_ONCE) * BYTES_PER_ENTRY : 0;
}

commands_event_t commands_push(commands_t *c, routing_t *routing, const uint8_t **at, const uint8_t *end,
                               can_frame_t *frame) {
    commands_event_t event = COMMANDS_NOTHING;

    while (event == COMMANDS_NOTHING) {
        *at += slcan_rx_push_text(&c->rx, *at, (size_t)(end - *at));
        if (*at == end) {
            break;
        }
        switch (slcan_rx_push_byte(&c->rx, *(*at)++, frame)) {
        case SLCAN_FRAME:
            event = COMMANDS_FRAME;
            break;
        case SLCAN_COMMAND:
            event = on_command(c, routing);
            break;
        case SLCAN_EMPTY:
            put_char(routing, SLCAN_CR);
            break;
        case SLCAN_BAD:
            routing->link[LINK_UART].rejected++;
            put_char(routing, SLCAN_BEL);
            break;
        case SLCAN_NOTHING:
            break;
        }
    }
    return event;
}

void commands_answer_frame(routing_t *routing, bool accepted) {
    put_char(routing, accepted ? SLCAN_CR : SLCAN_BEL);
}
