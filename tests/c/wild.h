/* Parameters from all over their ranges, for the tests that put a step under the sanitizers. */
#ifndef PLUMB_TESTS_WILD_PARAMS_H
#define PLUMB_TESTS_WILD_PARAMS_H

#include "check.h"
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

#endif
