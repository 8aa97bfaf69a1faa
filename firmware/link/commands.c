#include "commands.h"
#include "generated/messages.h"

#define HARDWARE_VERSION "01"

/* The most that received bytes may cause: two of them, "V\r", an entry of the outbox. And what may come on
 * top at once: the end of a line begun before, answered by CR and one frame; a CR behind that; and a
 * SETPOINT_USED that is still owed; and urgent frames. */
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
    case 'S': /* bit rates: there is no bus behind this link */
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
