/* The turntable's step on parameters and counts from all over their ranges: under the sanitizers no sum of it
 * may overflow, and whatever comes, variances stay variances and attitudes rotations. */
#include "wild.h"

#define SETS  400U
#define STEPS 400U

/* A set that the firmware accepts. */
static control_params_t wild(void) {
    params_t all;
    params_default(&all);
    do {
        for (uint16_t i = 0; i < sizeof all.control / 4U; i++)
            wild_word(&all, i);
        all.control.system = CONTROL_TURNTABLE;
        all.control.fusion.rest_steps %= 60U;
        all.control.fusion.gyro_age_step_q24 %= all.control.fusion.gyro_period_step_q24;
    } while (!control_params_valid(&all.control));
    return all.control;
}

/* Length of a quaternion, near 1. */
static bool rotation(const quaternion_t *q) {
    const double w = q->w / 1073741824.0, x = q->x / 1073741824.0, y = q->y / 1073741824.0,
                 z = q->z / 1073741824.0;
    const double excess = w * w + x * x + y * y + z * z - 1.0;
    return excess > -1e-5 && excess < 1e-5;
}

static void check_words(const turntable_words_t *w) {
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
    const control_params_t p = wild();
    control_t c;
    control_init(&c, &p);
    int16_t raw[CONTROL_RAW_MAX] = {0};
    for (unsigned step = 0; step < STEPS; step++) {
        wild_counts(raw, set, INT16_MIN + 1);
        int16_t given[CONTROL_RAW_MAX];
        for (unsigned i = 0; i < CONTROL_RAW_MAX; i++)
            given[i] = raw[i];
        for (unsigned sensor = 0; sensor < 2U; sensor++)
            if (check_random() % 4U < set / 4U % 4U)
                given[3U * sensor] = PREFILTER_NO_SAMPLE;
        control_step(&c, &p, given, check_random_wild());
        check_words(&c.turntable.words);
    }
}

int main(void) {
    for (uint32_t set = 0; set < SETS; set++)
        run_wild(set);
    return check_failures == 0 ? 0 : 1;
}
