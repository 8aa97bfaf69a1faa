#include "samples.h"
#include "app/board_guard.h"
#include "app/board_sensors.h"
#include "idle.h"
#include "nvic.h"
#include <string.h>

#define LATE_MAX 255U

static int16_t samples[2][BOARD_RAW_MAX]; /* sample n is in samples[n % 2] */
static volatile uint32_t done, missed;    /* samples published; periods without one */
BOARD_GUARDED static uint32_t done_seen, missed_seen;
BOARD_GUARDED static uint32_t late;

int16_t *samples_next(void) {
    return samples[(done + 1U) % 2U];
}

void samples_publish(void) {
    memory_fence(); /* the raw counts are in memory before `done` announces them */
    done++;
    idle_end();
}

void samples_miss(void) {
    missed++;
}

void samples_clear(void) {
    memset(samples, 0, sizeof samples); /* channels that the sensors do not fill read 0 */
    done_seen = done;
    missed_seen = missed;
    late = 0U;
}

bool samples_wait(void) {
    return done != done_seen;
}

bool samples_poll(void) {
    const uint32_t now = done;
    memory_fence(); /* the raw counts are read after `done` */
    const bool ticked = now != done_seen;
    const uint32_t more = missed - missed_seen + (ticked ? now - done_seen - 1U : 0U);
    missed_seen = missed;
    done_seen = now;
    late = more < LATE_MAX - late ? late + more : LATE_MAX;
    return ticked;
}

void samples_read(int16_t *raw) {
    memcpy(raw, samples[done_seen % 2U], sizeof samples[0]);
}

uint32_t samples_late(void) {
    return late;
}
