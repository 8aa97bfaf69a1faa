#include "outbox.h"

void outbox_init(outbox_t *box) {
    *box = (outbox_t){0};
}

static size_t waiting(const outbox_t *box) {
    return (uint16_t)(box->head - box->tail);
}

size_t outbox_room(const outbox_t *box) {
    return OUTBOX_BYTES - waiting(box);
}

bool outbox_telemetry_fits(const outbox_t *box, size_t frames) {
    return outbox_room(box) >= OUTBOX_RESERVE + frames * SLCAN_FRAME_CHARS;
}

void outbox_put(outbox_t *box, const uint8_t *text, size_t count) {
    if (count > outbox_room(box)) {
        return;
    }
    for (size_t i = 0; i < count; i++) {
        box->text[box->head % OUTBOX_BYTES] = text[i];
        box->head++;
    }
}

static void put_sealed(outbox_t *box, can_frame_t *frame, uint8_t counter, uint8_t flags) {
    uint8_t text[SLCAN_FRAME_CHARS];

    e2e_seal(frame, counter, flags);
    outbox_put(box, text, slcan_encode(frame, text));
}

static uint8_t next_counter(outbox_t *box, uint16_t id) {
    const uint8_t counter = box->counter[OUTBOX_SLOT(id)];

    box->counter[OUTBOX_SLOT(id)] = (uint8_t)(counter + 1U) & E2E_COUNTER_MASK;
    return counter;
}

void outbox_reply(outbox_t *box, can_frame_t frame, uint8_t flags) {
    put_sealed(box, &frame, next_counter(box, frame.id), flags);
}

void outbox_numbered(outbox_t *box, can_frame_t frame, uint8_t counter, uint8_t flags) {
    if (!outbox_telemetry_fits(box, 1)) {
        box->dropped++;
        return;
    }
    put_sealed(box, &frame, counter, flags);
}

void outbox_telemetry(outbox_t *box, can_frame_t frame, uint8_t flags) {
    outbox_numbered(box, frame, next_counter(box, frame.id), flags);
}

size_t outbox_take(outbox_t *box, uint8_t *out, size_t room) {
    size_t count = 0;

    while (count < room && box->tail != box->head) {
        out[count] = box->text[box->tail % OUTBOX_BYTES];
        box->tail++;
        count++;
    }
    return count;
}
