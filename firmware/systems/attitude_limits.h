/* Limits that several parts of `attitude` share, and sums that saturate at them. Included by attitude.c
 * alone. */
#ifndef PLUMB_SYSTEMS_ATTITUDE_LIMITS_H
#define PLUMB_SYSTEMS_ATTITUDE_LIMITS_H

#include "core/error_filter.h"
#include "plumb/attitude.h"

/* SELDOM: called once a block or less, so small rather than fast. SHARED: called in every step and in a gap,
 * so it is in the image once. */
#if defined(__GNUC__)
#define SELDOM __attribute__((noinline, cold)) static
#define SHARED __attribute__((noinline)) static
#else
#define SELDOM static
#define SHARED static
#endif

#define ONE_Q30               (1 << 30)
#define SIXTH_Q32             715827883
#define VELOCITY_SATURATED(x) SATURATE(x, 31) /* within 4 g s Q28, 39 m/s */
#define VELOCITY_ADDED_Q26    13421773U /* 0.2 g^2 s^2: most variance that lost accelerations add to a block */
#define LONGEST_RUN           255U      /* steps of a gap or at a limit: the count stops here */
#define HALF_LIMIT_Q30        461708984 /* 0.43 rad: with coning below 1/2 */

/* sat_i32() for code that runs seldom: in the image once. */
SELDOM int32_t saturated(int64_t x) {
    return sat_i32(x);
}

static uint32_t limited(uint64_t x, uint32_t most) {
    return x < most ? (uint32_t)x : most;
}

/* Add to a variance, at most up to a limit. */
SELDOM void add_limited(int32_t *variance, uint64_t by, uint32_t most) {
    *variance = (int32_t)min_u32((uint32_t)*variance + limited(by, most), most);
}

#endif
