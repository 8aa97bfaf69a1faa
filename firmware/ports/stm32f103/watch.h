/* A signal that hangs: the same value for longer than noise allows. */
#ifndef PLUMB_STM32F103_WATCH_H
#define PLUMB_STM32F103_WATCH_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint16_t last;
    uint16_t same; /* times in a row that the value was the one before, stops at 65535 */
} watch_t;

/* Take the next value; true while `limit` repetitions or more have gone by (limit 0: never). */
static inline bool watch_stuck(watch_t *watch, uint16_t value, uint32_t limit) {
    watch->same = (uint16_t)(value != watch->last ? 0u : watch->same + (watch->same < UINT16_MAX ? 1u : 0u));
    watch->last = value;
    return limit > 0u && watch->same >= limit;
}

#endif
