#include "outbox.h"
#include <string.h>

void outbox_init(outbox_t *box) {
    *box = (outbox_t){0};
}

void outbox_clear(outbox_t *box) {
    box->count = 0;
    box->gone = 0;
}

size_t outbox_room(const outbox_t *box) {
    return OUTBOX_ENTRIES - (size_t)box->count;
}

bool outbox_telemetry_fits(const outbox_t *box, size_t frames) {
    return outbox_room(box) >= OUTBOX_RESERVE + frames;
}

bool outbox_long_fits(const outbox_t *box) {
    return outbox_telemetry_fits(box, 1U + OUTBOX_ROUND);
}

/* Entry n, counted from the oldest. */
static outbox_entry_t *entry(outbox_t *box, unsigned n) {
    return &box->ring[(box->first + n) % OUTBOX_ENTRIES];
}

static bool is_text(const outbox_entry_t *e) {
    return (e->id & OUTBOX_IS_TEXT) != 0;
}

static unsigned characters(const outbox_entry_t *e) {
    return e->id & ~OUTBOX_IS_TEXT;
}

/* A new last entry; NULL when there is no room. */
static outbox_entry_t *append(outbox_t *box) {
    if (box->count >= OUTBOX_ENTRIES) {
        return NULL;
    }
    box->count++;
    return entry(box, box->count - 1U);
}

static void remove_first(outbox_t *box) {
    box->first = (uint8_t)((box->first + 1U) % OUTBOX_ENTRIES);
    box->count--;
    box->gone = 0;
}

void outbox_put(outbox_t *box, const uint8_t *text, size_t count) {
    outbox_entry_t *e = box->count > 0 ? entry(box, box->count - 1U) : NULL;

    if (e == NULL || !is_text(e) || characters(e) + count > OUTBOX_TEXT) {
        e = append(box);
        if (e == NULL) {
            return;
        }
        e->id = OUTBOX_IS_TEXT;
    }
    memcpy(&e->data[characters(e)], text, count);
    e->id = (uint16_t)(e->id + count);
}

static void put_sealed(outbox_t *box, can_frame_t *frame, uint8_t counter, uint8_t flags) {
    outbox_entry_t *const e = append(box);

    if (e != NULL) {
        e2e_seal(frame, counter, flags);
        e->id = frame->id;
        memcpy(e->data, frame->data, sizeof e->data);
    }
}

static uint8_t next_counter(outbox_t *box, uint16_t id) {
    const uint8_t counter = box->counter[OUTBOX_SLOT(id)];

    box->counter[OUTBOX_SLOT(id)] = (uint8_t)(counter + 1U) & E2E_COUNTER_MASK;
    return counter;
}

void outbox_reply(outbox_t *box, can_frame_t frame, uint8_t flags) {
    put_sealed(box, &frame, next_counter(box, frame.id), flags);
}

void outbox_urgent(outbox_t *box, can_frame_t frame, uint8_t flags) {
    unsigned place = box->gone > 0 ? 1U : 0U;

    if (box->count >= OUTBOX_ENTRIES) {
        return;
    }
    while (place < box->count && entry(box, place)->id == frame.id) {
        place++;
    }
    e2e_seal(&frame, next_counter(box, frame.id), flags);
    box->first = (uint8_t)((box->first + OUTBOX_ENTRIES - 1U) % OUTBOX_ENTRIES);
    box->count++;
    for (unsigned i = 0; i < place; i++) {
        *entry(box, i) = *entry(box, i + 1U);
    }
    entry(box, place)->id = frame.id;
    memcpy(entry(box, place)->data, frame.data, sizeof frame.data);
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

static can_frame_t frame_of(const outbox_entry_t *e) {
    can_frame_t frame = {.id = e->id, .dlc = CAN_FRAME_DLC};

    memcpy(frame.data, e->data, sizeof frame.data);
    return frame;
}

/* The characters of an entry, at most SLCAN_FRAME_CHARS; returns how many. */
static size_t text_of(const outbox_entry_t *e, uint8_t *text) {
    if (is_text(e)) {
        memcpy(text, e->data, characters(e));
        return characters(e);
    }
    const can_frame_t frame = frame_of(e);
    return slcan_encode(&frame, text);
}

size_t outbox_pop_text(outbox_t *box, uint8_t *out, size_t room) {
    size_t count = 0;

    while (count < room && box->count > 0) {
        uint8_t rest[SLCAN_FRAME_CHARS];
        const bool whole = box->gone == 0 && room - count >= SLCAN_FRAME_CHARS;
        const size_t length = text_of(entry(box, 0), whole ? out + count : rest);
        const size_t left = length - box->gone;
        const size_t taken = left < room - count ? left : room - count;

        if (!whole) {
            memcpy(out + count, rest + box->gone, taken);
        }
        box->gone = (uint8_t)(box->gone + taken);
        count += taken;
        if (box->gone >= length) {
            remove_first(box);
        }
    }
    return count;
}

bool outbox_pop_frame(outbox_t *box, can_frame_t *frame) {
    if (box->count == 0) {
        return false;
    }
    *frame = frame_of(entry(box, 0));
    remove_first(box);
    return true;
}
