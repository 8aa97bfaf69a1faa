/* Detector of a stuck signal: one that keeps its value for longer than its noise allows. */
#ifndef PLUMB_STM32F103_WATCH_H
#define PLUMB_STM32F103_WATCH_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint16_t last;
    uint16_t same; /* times in a row that the value was the one before, stops at 65535 */
} watch_t;

/* Feed the next value; true while it has repeated at least `limit` times (limit 0: never true). */
static inline bool watch_stuck(watch_t *watch, uint16_t value, uint32_t limit) {
    watch->same = (uint16_t)(value != watch->last ? 0u : watch->same + (watch->same < UINT16_MAX ? 1u : 0u));
    watch->last = value;
    return limit > 0u && watch->same >= limit;
}

#endif
