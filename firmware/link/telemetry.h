/* Telemetry: what each step sends. Always STEP with its digest; the frames and words that SELECT chose.
 *
 * Owns the selection and what is left to send of the last step. Frames with names for their words go out at
 * once, single words as the outboxes have room. */
#ifndef PLUMB_LINK_TELEMETRY_H
#define PLUMB_LINK_TELEMETRY_H

#include "run.h"
#include "systems/control.h"

#define TELEMETRY_WORD_BANKS ((CONTROL_RECORD_WORDS_MAX + 31U) / 32U)

typedef struct {
    uint32_t *digest;     /* of the last RUN_QUEUE_LENGTH steps, for samples that come again */
    uint32_t frames_mask; /* bank 0 of SELECT */
    uint32_t words_mask[TELEMETRY_WORD_BANKS]; /* banks 1.. of SELECT */
    uint16_t selected;                         /* frames a step sends at once, STEP included */
    uint16_t word_next; /* of the last step's record, the next to be sent; CONTROL_RECORD_WORDS_MAX: none */
    uint8_t step_low;   /* counter of the last step's words: its number modulo 16 */
    uint16_t signals;   /* number of the first signal of its system */
    uint16_t dropped_told[LINKS]; /* the outbox's count of dropped frames at the last STEP */
} telemetry_t;

/* Nothing but STEP is selected. digest: RUN_QUEUE_LENGTH words, kept by the caller. */
void telemetry_init(telemetry_t *t, uint32_t *digest);

/* A run begins: no words are left to send. */
void telemetry_begin(telemetry_t *t);

/* Choose what a step sends: bank 0 frames, 1 to TELEMETRY_WORD_BANKS words. Frames that the system does not
 * have and words beyond its record are left out. */
void telemetry_select(telemetry_t *t, const control_params_t *params, uint16_t bank, uint32_t mask);

/* Nothing but STEP: when the system changes. */
void telemetry_select_nothing(telemetry_t *t);

/* After a step: STEP, RAW and the selected frames to all open links. flags: of STEP, but for
 * MESSAGE_STEP_DROPPED, which each link has of its own. The words follow with telemetry_send_words(). */
void telemetry_step(telemetry_t *t, routing_t *r, const control_t *c, const control_params_t *params,
                    uint16_t step, uint8_t flags);

/* The selected words of the last step (record: control_words()) that were not sent yet. pacer: the link whose
 * host paces the steps; words wait for room there. LINK_NONE: all go out now, and what finds no room is
 * dropped. Call after each step and on every turn of the loop. */
void telemetry_send_words(telemetry_t *t, routing_t *r, const void *record, link_t pacer);

/* True when all of the last step was sent and the next one's frames have room on a link. */
bool telemetry_has_room(const telemetry_t *t, const routing_t *r, link_t link);

/* STEP once more, for one of the last RUN_QUEUE_LENGTH steps. */
void telemetry_repeat_step(const telemetry_t *t, routing_t *r, const request_t *q, uint16_t step,
                           uint8_t flags);

#endif
