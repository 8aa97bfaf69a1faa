/* The phone's step on parameters and counts from all over their ranges: under the sanitizers no sum of it may
 * overflow, and whatever comes, variances stay variances and what has a limit keeps it. */
#include "wild.h"

#define SETS  400U
#define STEPS 300U

/* A set that the firmware accepts: Euler rates in three of four. */
static plumb_params_t wild(void) {
    params_t all;
    do {
        wild_control(&all, PLUMB_SYSTEM_PHONE);
        all.control.phone.rates =
            check_random() % 4U != 0U ? PLUMB_PHONE_EULER_RATES : PLUMB_PHONE_BODY_RATES;
    } while (!control_params_valid(&all.control));
    return all.control;
}

static void check_filter(const plumb_kalman_t *k) {
    CHECK(k->p00 >= 0 && k->p00 <= (int64_t)1 << 57 && k->p11 >= 0 && k->p11 < (int64_t)1 << 56);
    CHECK(k->k0_q29 >= 0 && k->k1_q29 <= 1 << 29 && k->k1_q29 >= -(1 << 29));
    CHECK(k->bias_turn_q61 >= -((int64_t)1 << 58) && k->bias_turn_q61 <= (int64_t)1 << 58);
}

static void check_words(const plumb_phone_words_t *w, const plumb_params_t *p) {
    check_filter(&w->pitch);
    check_filter(&w->roll);
    CHECK(w->tangent_q26 >= -(1 << 30) && w->tangent_q26 <= 1 << 30);
    CHECK(w->pitch_measured_turn_q32 >= -(1 << 30) && w->pitch_measured_turn_q32 <= 1 << 30);
    const bool roll_lost = (w->flags & PLUMB_PHONE_FLAG_ROLL_UNCORRECTED) != 0U;
    const bool pitch_lost = (w->flags & PLUMB_PHONE_FLAG_PITCH_UNCORRECTED) != 0U;
    CHECK(!pitch_lost || roll_lost);
    CHECK(w->roll_variance == (roll_lost ? p->roll.r_max : p->roll.r_base));
    CHECK(w->pitch_variance == (pitch_lost ? p->tilt.r_max : p->tilt.r_base));
    CHECK(!roll_lost || w->roll.innovation_turn_q32 == 0);
    CHECK(!pitch_lost || w->pitch.innovation_turn_q32 == 0);
    if (p->phone.rates == PLUMB_PHONE_BODY_RATES) {
        CHECK(w->tangent_q26 == 0);
    }
}

/* Counts that jump, rest, are small, or stand at an end. */
static void run_wild(uint32_t set) {
    const plumb_params_t p = wild();
    control_t c;
    control_init(&c, &p);
    int16_t raw[PLUMB_RAW_MAX] = {0};
    uint32_t clamped = 0;
    for (unsigned step = 0; step < STEPS; step++) {
        wild_counts(raw, set, INT16_MIN);
        control_step(&c, &p, raw, check_random_wild());
        check_words(&c.phone.words, &p);
        clamped += (c.phone.words.flags & PLUMB_PHONE_FLAGS_SATURATED) != 0U;
    }
    CHECK(c.phone.words.step == STEPS && c.phone.words.clamped_steps == clamped);
}

int main(void) {
    for (uint32_t set = 0; set < SETS; set++) {
        run_wild(set);
    }
    return check_failures == 0 ? 0 : 1;
}
