/* Parameters and counts from all over their ranges, for the tests that put a step under the sanitizers. */
#ifndef PLUMB_TESTS_WILD_H
#define PLUMB_TESTS_WILD_H

#include "check.h"
#include "control.h"
#include "params.h"

/* Word `index` of the table: a value of its range, every size as likely as any other; left alone where none
 * is found. */
static inline void wild_word(params_t *all, uint16_t index) {
    for (unsigned tries = 0; tries < 100U; tries++) {
        const uint32_t value = (uint32_t)check_random_wild();
        if (params_in_range(index, value)) {
            params_set_word(all, index, value);
            return;
        }
    }
}

/* The counts after `raw`: by the set they jump, rest or are small; now and then one stands at an end, `least`
 * or 32767. */
static inline void wild_counts(int16_t raw[CONTROL_RAW_MAX], uint32_t set, int16_t least) {
    for (unsigned i = 0; i < CONTROL_RAW_MAX; i++) {
        const uint32_t pick = check_random();
        if (set % 3U != 0U || pick % 20U == 0U)
            raw[i] = (int16_t)(uint16_t)(check_random() >> (set % 4U * 4U + 16U));
        if (pick % 32U == 1U)
            raw[i] = (pick & 0x8000U) != 0U ? INT16_MAX : least;
    }
}

#endif
