#include "routing.h"
#include "generated/messages.h"
#include <string.h>

#define COUNTER_UNKNOWN 0xFFU

static void forget_counters(routing_link_t *l) {
    memset(l->counter, COUNTER_UNKNOWN, OUTBOX_COUNTERS);
}

void routing_buffers_init(routing_buffers_t *buffers) {
    for (unsigned i = 0; i < LINKS; i++) {
        outbox_init(&buffers->outbox[i]);
    }
}

void routing_init(routing_t *r, routing_buffers_t *buffers, uint32_t can_kbit) {
    r->can_kbit = can_kbit;
    for (unsigned i = 0; i < LINKS; i++) {
        r->link[i] = (routing_link_t){.outbox = &buffers->outbox[i], .counter = buffers->counter[i]};
        forget_counters(&r->link[i]);
    }
}

void routing_open(routing_t *r, link_t link, bool open, bool read_only) {
    routing_link_t *const l = &r->link[link];

    if (!open || (l->read_only && !read_only)) {
        l->greeted = false; /* the next host may be of another version */
    }
    l->open = open;
    l->read_only = read_only;
}

void routing_greet(routing_t *r, link_t link, bool good) {
    forget_counters(&r->link[link]);
    r->link[link].greeted = good;
}

bool routing_accept(routing_t *r, const request_t *request) {
    const can_frame_t *const f = request->frame;
    routing_link_t *const l = &r->link[request->link];
    const bool opens = request->link == LINK_CAN && f->id == MESSAGE_HELLO_ID; /* CAN has no command O */
    const bool stops = f->id == MESSAGE_DISARM_ID; /* any host may disarm, at any time */
    const bool good = e2e_check(f) && (opens || stops || (l->open && !l->read_only));

    l->rejected = (uint16_t)(l->rejected + !good);
    if (good) {
        l->received_us = request->now_us;
        l->open = l->open || opens;
    }
    return good;
}

void routing_note_counter(routing_t *r, const request_t *request) {
    const can_frame_t *const f = request->frame;
    routing_link_t *const l = &r->link[request->link];
    uint8_t *const last = &l->counter[OUTBOX_SLOT(f->id)];

    if (*last != COUNTER_UNKNOWN) {
        l->lost = (uint16_t)(l->lost + ((e2e_counter(f) - *last - 1U) & E2E_COUNTER_MASK));
    }
    *last = e2e_counter(f);
}

bool routing_poll(routing_t *r, uint32_t can_kbit, uint32_t now_us) {
    routing_link_t *const l = &r->link[LINK_CAN];
    const bool lost = l->open && now_us - l->received_us > ROUTING_SILENCE_US;

    if (lost) {
        routing_open(r, LINK_CAN, false, false);
        outbox_clear(l->outbox);
    }
    if (!l->open) {
        r->can_kbit = can_kbit;
    }
    return lost;
}

void routing_reply(routing_t *r, const request_t *request, can_frame_t frame, uint8_t flags) {
    outbox_reply(r->link[request->link].outbox, frame, flags);
}

void routing_ack(routing_t *r, const request_t *request, uint32_t detail) {
    const message_ack_t m = {.request = request->frame->id, .detail = detail};

    routing_reply(r, request, message_ack_pack(&m), e2e_counter(request->frame));
}

void routing_nack(routing_t *r, const request_t *request, uint16_t reason, uint16_t detail) {
    const message_nack_t m = {.request = request->frame->id, .reason = reason, .detail = detail};

    routing_reply(r, request, message_nack_pack(&m), e2e_counter(request->frame));
}

void routing_answer(routing_t *r, link_t link, can_frame_t frame, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (i == (unsigned)link) {
            outbox_reply(r->link[i].outbox, frame, flags);
        } else if (r->link[i].open) {
            outbox_telemetry(r->link[i].outbox, frame, flags);
        }
    }
}

void routing_telemetry(routing_t *r, can_frame_t frame, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (r->link[i].open) {
            outbox_telemetry(r->link[i].outbox, frame, flags);
        }
    }
}

void routing_numbered(routing_t *r, can_frame_t frame, uint8_t counter, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (r->link[i].open) {
            outbox_numbered(r->link[i].outbox, frame, counter, flags);
        }
    }
}
