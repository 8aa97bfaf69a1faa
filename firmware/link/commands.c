/* The UART's side of a session: SLCAN commands around the frames, each answered by CR or a bell. */
#include "links.h"
#include "messages.h"

#define HARDWARE_VERSION "01"

/* The most that received bytes may cause: two of them, "V\r", an entry of the outbox. And what may come on
 * top at once: the end of a line begun before, answered by CR and one frame; a CR behind that; and a
 * SETPOINT_USED that is still owed; and urgent frames. */
#define BYTES_PER_ENTRY 2U
#define ENTRIES_AT_ONCE (4U + OUTBOX_URGENT)

static void put_text(session_t *s, const uint8_t *text, size_t count) {
    outbox_put(s->link[LINK_UART].outbox, text, count);
}

static void put_char(session_t *s, uint8_t character) {
    put_text(s, &character, 1);
}

static void open_link(session_t *s, bool open, bool read_only) {
    links_open(s, LINK_UART, open, read_only);
    put_char(s, SLCAN_CR);
}

/* "N" and four digits: the unique id folded, enough to tell boards apart. */
static void reply_serial_number(session_t *s) {
    static const char hex[] = "0123456789ABCDEF";
    const uint32_t *id = s->board->unique_id;
    const uint32_t mixed = id[0] ^ id[1] ^ id[2];
    const uint32_t folded = (mixed >> 16) ^ mixed;
    uint8_t text[6] = {'N', 0, 0, 0, 0, SLCAN_CR};

    for (unsigned i = 0; i < 4; i++) {
        text[1 + i] = (uint8_t)hex[(folded >> (12U - 4U * i)) & 15U];
    }
    put_text(s, text, sizeof text);
}

static void on_command(session_t *s) {
    static const uint8_t version[] = {'V',
                                      HARDWARE_VERSION[0],
                                      HARDWARE_VERSION[1],
                                      '0' + MESSAGES_PROTOCOL_VERSION / 10U,
                                      '0' + MESSAGES_PROTOCOL_VERSION % 10U,
                                      SLCAN_CR};
    const bool alone = s->buffers->rx.length == 1;

    switch (alone || s->buffers->rx.line[0] == 'S' || s->buffers->rx.line[0] == 's' ? s->buffers->rx.line[0]
                                                                                    : 0) {
    case 'O':
        open_link(s, true, false);
        break;
    case 'L':
        open_link(s, true, true);
        break;
    case 'C':
        open_link(s, false, false);
        break;
    case 'S': /* bit rates: there is no bus behind this link */
    case 's':
        put_char(s, SLCAN_CR);
        break;
    case 'V':
        put_text(s, version, sizeof version);
        break;
    case 'N':
        reply_serial_number(s);
        break;
    default:
        put_char(s, SLCAN_BEL);
    }
}

size_t session_receive_room(const session_t *s) {
    const size_t room = outbox_room(s->link[LINK_UART].outbox);

    return room > ENTRIES_AT_ONCE ? (room - ENTRIES_AT_ONCE) * BYTES_PER_ENTRY : 0;
}

void session_receive(session_t *s, const uint8_t *bytes, size_t count, uint32_t now_us) {
    slcan_rx_t *const rx = &s->buffers->rx;

    for (size_t i = slcan_rx_text(rx, bytes, count); i < count;
         i += slcan_rx_text(rx, bytes + i, count - i)) {
        can_frame_t frame;

        switch (slcan_rx_take(rx, bytes[i++], &frame)) {
        case SLCAN_NOTHING:
            break;
        case SLCAN_EMPTY:
            put_char(s, SLCAN_CR);
            break;
        case SLCAN_COMMAND:
            on_command(s);
            break;
        case SLCAN_FRAME:
            if (links_accept(s, LINK_UART, &frame, now_us)) {
                put_char(s, SLCAN_CR); /* before whatever the frame is answered by */
                session_take_frame(s, LINK_UART, &frame, now_us);
            } else {
                put_char(s, SLCAN_BEL);
            }
            break;
        case SLCAN_BAD:
            s->link[LINK_UART].rejected++;
            put_char(s, SLCAN_BEL);
            break;
        }
    }
}
