/* Checks of one channel of counts: stuck, that is unchanged for longer than its noise allows, and at a rail.
 * The board's own inputs and injected samples have the same checks; only their limits differ. */
#ifndef PLUMB_CORE_WATCH_H
#define PLUMB_CORE_WATCH_H

#include <stdbool.h>
#include <stdint.h>

/* Counts at a rail before a channel counts as railed, however slow they are. */
#define WATCH_RAIL_LEAST 3U

typedef struct {
    int16_t last;
    uint16_t same;   /* times in a row that the count was the one before, stops at 65535 */
    uint16_t railed; /* counts in a row at a rail, stops at 65535 */
} watch_t;

/* Number of counts in limit_ms, one every interval_us, but at least `least`; 0 for a limit of 0, which means
 * never. */
static inline uint32_t watch_limit(uint32_t limit_ms, uint32_t interval_us, uint32_t least) {
    const uint32_t count = (1000U * limit_ms + interval_us - 1U) / interval_us;
    return limit_ms == 0U || count > least ? count : least;
}

static inline uint16_t watch_more(uint16_t count, bool goes_on) {
    return (uint16_t)(goes_on ? count + (count < UINT16_MAX ? 1U : 0U) : 0U);
}

/* Feed the next count; lowest, highest: its rails. */
static inline void watch_feed(watch_t *watch, int16_t count, int32_t lowest, int32_t highest) {
    watch->same = watch_more(watch->same, count == watch->last);
    watch->railed = watch_more(watch->railed, count <= lowest || count >= highest);
    watch->last = count;
}

/* True while the count has repeated at least `limit` times (limit 0: never true). */
static inline bool watch_stuck(const watch_t *watch, uint32_t limit) {
    return limit > 0U && watch->same >= limit;
}

/* True while at least `limit` counts in a row were at a rail (limit 0: never true). */
static inline bool watch_railed(const watch_t *watch, uint32_t limit) {
    return limit > 0U && watch->railed >= limit;
}

/* `bits` with bit i set or cleared. */
static inline uint16_t watch_bits(uint16_t bits, uint32_t i, bool set) {
    return (uint16_t)(set ? bits | 1U << i : bits & ~(1U << i));
}

#endif
