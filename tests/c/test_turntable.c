/* The turntable's step on parameters from inside, at the ends and outside of their ranges, as far as
 * control_params_valid() accepts them, and on counts of all kinds: under the sanitizers no sum of it may
 * overflow, and whatever comes, variances stay variances and attitudes rotations. */
#include "core/fusion.h"
#include "wild.h"
#include <stddef.h>

#define SETS  800U
#define STEPS 400U
#define FIRST (offsetof(plumb_params_t, gyro_filter) / 4U)
#define WORDS (sizeof(plumb_params_t) / 4U - FIRST)

/* A set that control_params_valid() accepts. One in four is offered with a word of any value, one in four
 * with most words at an end of their range. */
static plumb_params_t wild(uint32_t set) {
    params_t all;
    do {
        params_default(&all);
        for (uint16_t i = 0; i < sizeof all.control / 4U; i++) {
            if (set % 4U == 1U && check_random() % 4U != 0U) {
                wild_end(&all, i, check_random() % 2U != 0U);
            } else {
                wild_word(&all, i);
            }
        }
        all.control.system = PLUMB_SYSTEM_TURNTABLE;
        all.control.fusion.rest_steps %= 60U;
        if (all.control.fusion.gyro_age_step_q24 >= all.control.fusion.gyro_period_step_q24) {
            all.control.fusion.gyro_age_step_q24 = all.control.fusion.gyro_period_step_q24 - 1U;
        }
        wild_calibration(&all.control.gyro);
        wild_calibration(&all.control.angular);
        if (set % 4U == 2U) {
            params_set_word(&all, (uint16_t)(FIRST + check_random() % WORDS), (uint32_t)check_random_wild());
        }
    } while (!control_params_valid(&all.control));
    return all.control;
}

/* Length of a quaternion, near 1. */
static bool rotation(const plumb_quaternion_t *q) {
    const double w = q->w / 1073741824.0, x = q->x / 1073741824.0, y = q->y / 1073741824.0,
                 z = q->z / 1073741824.0;
    const double excess = w * w + x * x + y * y + z * z - 1.0;
    return excess > -1e-5 && excess < 1e-5;
}

static void check_words(const plumb_turntable_words_t *w) {
    for (unsigned i = 0; i < FUSION_STATES; i++) {
        const int64_t variance = w->covariance_q64[FUSION_CELL(i, i)];
        CHECK(variance >= 0 && variance <= (int64_t)1 << 59);
    }
    for (unsigned i = 0; i < 3U; i++) {
        CHECK(w->scale[i].variance_q60 >= 0 && w->lag[i].variance_q60 >= 0);
        CHECK(w->lag_step_q24[i] >= 0 && w->lag_step_q24[i] <= 1 << 28);
    }
    CHECK(rotation(&w->attitude) && rotation(&w->attitude_angular));
    CHECK(w->gyro_age_step_q24 < 1U << 28);
}

/* Sensors each missing in some of the steps, their counts jumping, resting or small. */
static void run_wild(uint32_t set) {
    const plumb_params_t p = wild(set);
    control_t c;
    control_init(&c, &p);
    int16_t raw[PLUMB_RAW_MAX] = {0};
    for (unsigned step = 0; step < STEPS; step++) {
        wild_counts(raw, set, INT16_MIN + 1);
        int16_t given[PLUMB_RAW_MAX];
        for (unsigned i = 0; i < PLUMB_RAW_MAX; i++) {
            given[i] = raw[i];
        }
        for (unsigned sensor = 0; sensor < 2U; sensor++) {
            if (check_random() % 4U < set / 4U % 4U) {
                given[3U * sensor] = PLUMB_PREFILTER_NO_SAMPLE;
            }
        }
        control_step(&c, &p, given, check_random_wild());
        check_words(&c.turntable.words);
    }
}

int main(void) {
    for (uint32_t set = 0; set < SETS; set++) {
        run_wild(set);
    }
    return check_failures == 0 ? 0 : 1;
}
