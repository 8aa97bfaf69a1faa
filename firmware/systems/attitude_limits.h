/* What the parts of `attitude` share: limits, sums that saturate at them, and how the parts are compiled. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_LIMITS_H
#define PLUMB_SYSTEMS_ATTITUDE_LIMITS_H

#include "core/error_filter.h"
#include "plumb/attitude.h"
#include "systems/parts.h"

/* The compiler options of the kernels save cycles in a small step. This step is large: without register
 * renaming, and with short instructions, it takes less flash and hardly more cycles.
 */
#if defined(__GNUC__) && defined(__arm__)
#pragma GCC optimize("no-rename-registers", "peephole2")
#endif

/* SELDOM: called once a block or less, so small rather than fast. SHARED: called in every step and in a gap,
 * so it is in the image once. */
#if defined(__GNUC__)
#define SELDOM __attribute__((noinline, cold))
#define SHARED __attribute__((noinline))
#else
#define SELDOM
#define SHARED
#endif

#define ONE_Q30               (1 << 30)
#define SIXTH_Q32             715827883
#define VELOCITY_SATURATED(x) SATURATE(x, 31) /* within 4 g s Q28, 39 m/s */
#define VELOCITY_ADDED_Q26    13421773U /* 0.2 g^2 s^2: most variance that lost accelerations add to a block */
#define LONGEST_RUN           255U      /* steps of a gap or at a limit: the count stops here */
#define HALF_LIMIT_Q30        461708984 /* 0.43 rad: with coning below 1/2 */

/* The slice of the last block that a step computes. Each measurement takes two slices: velocity x, y, and at
 * rest also bias x, y, z. The first slice of the first measurement also completes the growth. */
enum { SLICE_NONE, SLICE_CORRECT, SLICE_JUDGE, SLICE_TILT_X, SLICE_TILT_Y, SLICE_MEASURE };

/* sat_i32() for code that runs seldom: in the image once. */
SELDOM PART int32_t plumb_attitude_saturated(int64_t x);

static inline uint32_t limited(uint64_t x, uint32_t most) {
    return x < most ? (uint32_t)x : most;
}

/* Add to a variance, at most up to a limit. */
SELDOM PART void plumb_attitude_add_limited(int32_t *variance, uint64_t by, uint32_t most);

#endif
