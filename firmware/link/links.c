#include "links.h"
#include "messages.h"
#include <string.h>

#define LINKS_SILENCE_US 2000000U
#define COUNTER_UNKNOWN  0xFFU

void links_init(session_t *s) {
    for (unsigned i = 0; i < LINKS; i++) {
        s->link[i].outbox = &s->buffers->outbox[i];
        s->link[i].counter = s->buffers->counter[i];
        links_forget_counters(&s->link[i]);
    }
}

void links_forget_counters(session_link_t *l) {
    memset(l->counter, COUNTER_UNKNOWN, OUTBOX_COUNTERS);
}

void links_open(session_t *s, link_t link, bool open, bool read_only) {
    session_link_t *const l = &s->link[link];

    if (!open || (l->read_only && !read_only)) {
        l->greeted = false; /* whoever speaks next may be of another version */
    }
    l->open = open;
    l->read_only = read_only;
    if ((!open || read_only) && s->run_owner == link) {
        /* At once: it may be open again by the next poll. */
        arming_disarm_host(&s->arming, ARMING_BLOCK_CLOSED);
    }
}

bool links_accept(session_t *s, link_t link, const can_frame_t *f, uint32_t now_us) {
    session_link_t *const l = &s->link[link];
    const bool opens = link == LINK_CAN && f->id == MESSAGE_HELLO_ID; /* no line of text says O there */
    const bool stops =
        f->id == MESSAGE_DISARM_ID; /* anybody may, always: a closed link is no reason to go on */
    const bool good = e2e_check(f) && (opens || stops || (l->open && !l->read_only));

    l->rejected = (uint16_t)(l->rejected + !good);
    if (good) {
        l->heard_us = now_us;
        random_stir(&s->random, now_us);
        l->open = l->open || opens;
    }
    return good;
}

void links_note_counter(session_link_t *l, const can_frame_t *f) {
    uint8_t *const last = &l->counter[OUTBOX_SLOT(f->id)];

    if (*last != COUNTER_UNKNOWN) {
        l->lost = (uint16_t)(l->lost + ((e2e_counter(f) - *last - 1U) & E2E_COUNTER_MASK));
    }
    *last = e2e_counter(f);
}

void links_poll(session_t *s, uint32_t now_us) {
    session_link_t *const l = &s->link[LINK_CAN];

    if (l->open && now_us - l->heard_us > LINKS_SILENCE_US) {
        links_open(s, LINK_CAN, false, false);
        outbox_clear(l->outbox); /* nobody is there: not to be said to who comes next */
    }
    if (!l->open) {
        s->can_kbit = s->params->can_bitrate_kbit;
    }
}

void links_reply(session_t *s, can_frame_t frame, uint8_t flags) {
    outbox_reply(s->link[s->asked].outbox, frame, flags);
}

void links_answer(session_t *s, link_t asked, can_frame_t frame, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (i == (unsigned)asked) {
            outbox_reply(s->link[i].outbox, frame, flags);
        } else if (s->link[i].open) {
            outbox_telemetry(s->link[i].outbox, frame, flags);
        }
    }
}

void links_telemetry(session_t *s, can_frame_t frame, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (s->link[i].open) {
            outbox_telemetry(s->link[i].outbox, frame, flags);
        }
    }
}

void links_numbered(session_t *s, can_frame_t frame, uint8_t counter, uint8_t flags) {
    for (unsigned i = 0; i < LINKS; i++) {
        if (s->link[i].open) {
            outbox_numbered(s->link[i].outbox, frame, counter, flags);
        }
    }
}
