/* Parameters and counts from all over their ranges, for the tests that put a step under the sanitizers. */
#ifndef PLUMB_TESTS_WILD_H
#define PLUMB_TESTS_WILD_H

#include "check.h"
#include "core/fixed.h"
#include "generated/params.h"
#include "systems/control.h"

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

/* A table of this system in which about half of the control core's words are wild. */
static inline void wild_control(params_t *all, uint32_t system) {
    params_default(all);
    for (uint16_t i = 0; i < sizeof all->control / 4U; i++) {
        if (check_random() % 2U == 0U) {
            wild_word(all, i);
        }
    }
    all->control.system = system;
}

/* Word `index` of the table: the upper or the lower end of its range, found from the value that is there. */
static inline void wild_end(params_t *all, uint16_t index, bool upper) {
    const uint32_t from = params_word(all, index);
    uint32_t away = 0;
    for (uint32_t step = 0x80000000U; step != 0U; step >>= 1) {
        const uint32_t further = away + step;
        if (further > away && params_in_range(index, upper ? from + further : from - further)) {
            away = further;
        }
    }
    params_set_word(all, index, upper ? from + away : from - away);
}

/* A calibration whose values reach +-PLUMB_CALIBRATION_LIMIT, or a share of it, at both ends of its counts.
 */
static inline void wild_calibration(plumb_calibration_params_t *c) {
    const int32_t low = asr32(check_random_wild(), 16), high = asr32(check_random_wild(), 16);
    c->raw_min = min_i32(low, high);
    c->raw_max = max_i32(low, high);
    const int32_t span = c->raw_max - c->raw_min + 1;
    const int32_t half = (int32_t)(PLUMB_CALIBRATION_LIMIT >> (check_random() % 4U * 8U));
    c->gain = half / max_i32(span, 2) * 2 * (check_random() % 2U != 0U ? 1 : -1);
    c->offset = wrap_i32(0U - (uint32_t)c->gain * (uint32_t)((c->raw_min + c->raw_max) / 2));
}

/* The counts after `raw`: by the set they jump, rest or are small; now and then one stands at an end, `least`
 * or 32767. */
static inline void wild_counts(int16_t raw[PLUMB_RAW_MAX], uint32_t set, int16_t least) {
    for (unsigned i = 0; i < PLUMB_RAW_MAX; i++) {
        const uint32_t pick = check_random();
        if (set % 3U != 0U || pick % 20U == 0U) {
            raw[i] = (int16_t)(uint16_t)(check_random() >> (set % 4U * 4U + 16U));
        }
        if (pick % 32U == 1U) {
            raw[i] = (pick & 0x8000U) != 0U ? INT16_MAX : least;
        }
    }
}

#endif
