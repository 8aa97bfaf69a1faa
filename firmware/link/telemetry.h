/* Telemetry: the frames of each step. STEP with its digest always; the frames and words that SELECT chose.
 *
 * Owns the selection and the words of the last step that are not sent yet. RAW and the frames that the system
 * declares go out at once, single words as the outboxes have room. */
#ifndef PLUMB_LINK_TELEMETRY_H
#define PLUMB_LINK_TELEMETRY_H

#include "run.h"
#include "systems/control.h"

#define TELEMETRY_WORD_BANKS ((CONTROL_RECORD_WORDS_MAX + 31U) / 32U)

typedef struct {
    uint32_t *digest;                          /* of the last RUN_QUEUE_LENGTH steps, for repeated samples */
    uint32_t frames_mask;                      /* bank 0 of SELECT */
    uint32_t words_mask[TELEMETRY_WORD_BANKS]; /* banks 1.. of SELECT */
    uint16_t selected;                         /* frames a step sends at once, STEP included */
    uint16_t word_next; /* place in the record of the next word to send; CONTROL_RECORD_WORDS_MAX: none */
    uint8_t step_low;   /* counter of the last step's words: its number modulo 16 */
    uint16_t signals;   /* number of the system's first signal */
    uint16_t dropped_sent[LINKS]; /* the outbox's count of dropped frames at the last STEP */
} telemetry_t;

/* Select STEP only. digest: RUN_QUEUE_LENGTH words, in memory that the caller keeps. */
void telemetry_init(telemetry_t *t, uint32_t *digest);

/* Call when a run begins: drops the words that are not sent yet. */
void telemetry_begin(telemetry_t *t);

/* Select what a step sends: bank 0 selects frames, banks 1 to TELEMETRY_WORD_BANKS select words. Frames that
 * the system does not have and words beyond its record are ignored. */
void telemetry_select(telemetry_t *t, const plumb_params_t *params, uint16_t bank, uint32_t mask);

/* Select STEP only; for a change of the system. */
void telemetry_select_nothing(telemetry_t *t);

/* Call after each step: sends STEP and the selected frames to all open links. flags: of STEP, without
 * MESSAGE_STEP_DROPPED, which is added for each link. The words follow by telemetry_send_words(). */
void telemetry_step(telemetry_t *t, routing_t *r, const control_t *c, const plumb_params_t *params,
                    uint16_t step, uint8_t flags);

/* Send the selected words of the last step (record: control_words()) that were not sent yet. pacer: the link
 * whose host paces the steps; words wait for room there. LINK_NONE: all go out now, and words without room
 * are dropped. Call after each step and on every whole turn of the loop. */
void telemetry_send_words(telemetry_t *t, routing_t *r, const void *record, link_t pacer);

/* True while words of the last step wait for room. */
static inline bool telemetry_waits(const telemetry_t *t) {
    return t->word_next != CONTROL_RECORD_WORDS_MAX;
}

/* True when all words of the last step were sent and the next step's frames have room on a link. */
bool telemetry_has_room(const telemetry_t *t, const routing_t *r, link_t link);

/* Send STEP again, for one of the last RUN_QUEUE_LENGTH steps. */
void telemetry_repeat_step(const telemetry_t *t, routing_t *r, const request_t *q, uint16_t step,
                           uint8_t flags);

#endif
