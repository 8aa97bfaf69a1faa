/* Samples of the board's own sensors: written by interrupts, read by the loop.
 *
 * Sample n lies in place n % 2: while one is being written, the one before can be read for a whole period. */
#ifndef PLUMB_STM32F103_SAMPLES_H
#define PLUMB_STM32F103_SAMPLES_H

#include <stdbool.h>
#include <stdint.h>

/* ---- for interrupts of one priority ---- */

/* Where the next sample's raw counts go, BOARD_RAW_MAX places. */
int16_t *samples_next(void);

/* They are complete: a tick. */
void samples_publish(void);

/* A period has no sample. */
void samples_miss(void);

/* ---- for the loop ---- */

/* Begin anew: all places 0, nothing waits, nothing is late. While no period runs. */
void samples_clear(void);

/* True when there is a sample that was not asked about before. */
bool samples_poll(void);

/* The sample of the last samples_poll(), BOARD_RAW_MAX counts. */
void samples_read(int16_t *raw);

/* Periods since samples_clear() without a sample, or whose sample was not asked for in time; stops at 255. */
uint32_t samples_late(void);

#endif
