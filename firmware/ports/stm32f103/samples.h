/* Samples of the board's own sensors: interrupts write them, the main loop reads them.
 *
 * A double buffer: while an interrupt fills one half, the loop may read the previous sample from the other
 * for a whole period. */
#ifndef PLUMB_STM32F103_SAMPLES_H
#define PLUMB_STM32F103_SAMPLES_H

#include <stdbool.h>
#include <stdint.h>

/* ---- for interrupts of one priority ---- */

/* Buffer for the next sample's raw counts, BOARD_RAW_MAX of them. */
int16_t *samples_next(void);

/* The counts in samples_next() are complete: makes the tick, and wakes the loop. */
void samples_publish(void);

/* Counts a period without a sample. */
void samples_miss(void);

/* ---- for the loop ---- */

/* Set all counts to 0, drop waiting samples, and count no late period. Call while no period runs. */
void samples_clear(void);

/* True when a sample was published since the last samples_poll(). */
bool samples_wait(void);

/* True when a sample was published since the last call. */
bool samples_poll(void);

/* The sample of the last samples_poll(), BOARD_RAW_MAX counts. */
void samples_read(int16_t *raw);

/* Periods since samples_clear() that had no sample, or whose sample the loop did not fetch before the next
 * one; stops at 255. */
uint32_t samples_late(void);

#endif
