/* One macro and one generator for the C tests: a failed check says where and what, and the program goes on.
 */
#ifndef PLUMB_TESTS_CHECK_H
#define PLUMB_TESTS_CHECK_H

#include <stdint.h>
#include <stdio.h>

static int check_failures;

#define CHECK(condition)                                                                                     \
    ((condition)                                                                                             \
         ? (void)0                                                                                           \
         : (void)(check_failures++ < 10 && printf("%s:%d: not %s\n", __FILE__, __LINE__, #condition)))

/* A fixed sequence: upper half of a 64-bit linear congruence (Knuth's MMIX constants). */
static uint64_t check_random_state = 1;

static inline uint32_t check_random(void) {
    check_random_state = check_random_state * 6364136223846793005U + 1442695040888963407U;
    return (uint32_t)(check_random_state >> 32);
}

/* Any int32, of every magnitude alike, now and then an extreme. */
static inline int32_t check_random_wild(void) {
    static const int32_t corners[] = {INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX - 1, INT32_MAX};
    const uint32_t pick = check_random();
    if (pick % 16U == 0U) {
        return corners[pick / 16U % 7U];
    }
    const uint32_t magnitude = check_random() >> (pick / 16U % 32U);
    return (int32_t)((pick & 0x80000000U) != 0U ? 0U - magnitude : magnitude);
}

#endif
