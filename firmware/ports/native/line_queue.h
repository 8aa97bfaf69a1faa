/* The places of a queue between a simulated line and the board. */
#ifndef PLUMB_NATIVE_LINE_QUEUE_H
#define PLUMB_NATIVE_LINE_QUEUE_H

#include <stdint.h>

/* Free-running counts; the caller owns the ring that they index. */
typedef struct {
    uint32_t in, out;
} line_queue_t;

static inline uint32_t line_queue_used(const line_queue_t *q) {
    return q->in - q->out;
}

/* Time at which `count` bytes or frames (> 0) have passed, the first of them at `first_ns`. */
static inline uint64_t line_queue_passed_ns(uint64_t first_ns, uint32_t count, uint32_t each_ns) {
    return first_ns + (uint64_t)(count - 1U) * each_ns;
}

#endif
