/* Injected samples in real time: whether they are new, and whether their counts can be trusted.
 *
 * New: SAMPLE carries six bits of its number. A sample counts when it is ahead of the last one that counted,
 * by no more than its time of arrival allows. A repeated sample does not count, nor does a sample from a loop
 * of up to 32 samples that is replayed. A longer loop either loses numbers (more than 25 % in 250 ms is too
 * much) or is detected: the counts of each number equal those of 64 numbers ago.
 *
 * Trusted: the checks of core/watch.h that the board's own inputs have, at the rate of the samples. Times are
 * in us of the board's clock; differences are taken modulo 2^32. */
#ifndef PLUMB_LINK_INJECTED_H
#define PLUMB_LINK_INJECTED_H

#include "core/watch.h"
#include "generated/params.h"
#include "systems/control.h"

#define INJECTED_NUMBERS 64U

typedef struct {
    uint8_t *marks;       /* INJECTED_NUMBERS: a hash of the counts that came last with each number */
    bool begun;           /* a sample has come, and its source has not been silent since */
    bool silent;          /* no new sample for too long, or none at all */
    bool lossy;           /* more than 25 % of the last 250 ms were lost */
    uint8_t number;       /* of the last sample that counted */
    uint8_t repeats;      /* samples in a row whose counts were those of 64 numbers ago */
    uint32_t received_us; /* arrival of the last sample, whether it counted or not */
    uint32_t counted_us;  /* arrival of the last one that counted */
    uint32_t share_us;    /* when the present 125 ms began */
    uint16_t came, lost;  /* samples in them, by number */
    uint16_t came_before, lost_before; /* in the 125 ms before */
    uint16_t railed, stuck;            /* one bit a channel */
    watch_t watches[CONTROL_COUNTS_MAX];
} injected_t;

/* marks: INJECTED_NUMBERS bytes, in memory that the caller keeps. */
void injected_init(injected_t *in, uint8_t *marks);

/* Call at the start of a run. */
void injected_begin(injected_t *in);

/* The number of a sample has come. False when it does not count; *lost: samples that are missing before it,
 * after a silence modulo 64.
 */
bool injected_counts(injected_t *in, unsigned number, uint32_t period_us, uint32_t now_us, uint16_t *lost);

/* Count a sample as lost that would count, because one of its frames is missing. */
void injected_spoilt(injected_t *in);

/* Check the counts of a sample that counts. system: NULL, or without plausibility: its counts are not
 * checked.
 */
void injected_check(injected_t *in, const int16_t raw[PLUMB_RAW_MAX], const control_system_t *system,
                    const params_t *params);

/* How long the next injected_poll() may wait: until the source has been silent for too long. */
uint32_t injected_within_us(const injected_t *in, uint32_t period_us, uint32_t now_us);

/* Call on every whole turn of the loop. */
void injected_poll(injected_t *in, uint32_t period_us, uint32_t now_us);

/* True while no new samples come, or too few. */
bool injected_stale(const injected_t *in);

#endif
