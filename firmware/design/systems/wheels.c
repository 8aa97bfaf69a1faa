#include "plumb/wheels.h"
#include "design/systems/wheels_settings.h"

#define TAU          6.283185307179586
#define GRAVITY_MPS2 9.80665
#define COUNT_MOST   ((int64_t)1 << 30)
#define COUNTS_MOST  32767
#define RATE_MAX_DPS 1440.0

/* The turn rate of a count, a count of the turn rate, and the most counts. */
static void count_words(plumb_design_t *d, const plumb_wheels_turning_tuning_t *t, wide_t dt,
                        plumb_wheels_params_t *words) {
    if (t->track_m == 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "turning.track_m", t->track_m, -DESIGN_NO_LIMIT,
                            DESIGN_NO_LIMIT);
        return;
    }
    const wide_t around_m = wide_mul(wide_of(plumb_design_bounded(t->track_m)), wide_of(TAU));
    const wide_t per_m = wide_div(wide_div(wide_of(0x1p28), dt), around_m);
    const int64_t count =
        plumb_design_scaled(d, "turning.count_m", t->count_m, per_m, -COUNT_MOST, COUNT_MOST);
    const int64_t size = count < 0 ? -count : count;
    const wide_t shown =
        wide_div(wide_product(plumb_design_bounded(t->wheels_max_dps), 0x1p28), wide_of(360.0));
    if (wide_compare(shown, wide_of((double)size)) < 0 || t->wheels_max_dps > RATE_MAX_DPS) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "turning.wheels_max_dps", t->wheels_max_dps,
                            (double)size * 360.0 / 0x1p28, RATE_MAX_DPS);
        return;
    }
    words->count_turnps_q28 = (int32_t)count;
    words->counts_max = COUNTS_MOST;
    words->turn_counts_q36 = 0;
    if (size != 0) {
        wide_t fraction;
        const int64_t most = wide_floor(shown, &fraction) / size;
        const int64_t back = (((int64_t)1 << 36) + size / 2) / size,
                      within = back < COUNT_MOST ? back : COUNT_MOST;
        words->counts_max = most < COUNTS_MOST ? (int32_t)most : COUNTS_MOST;
        words->turn_counts_q36 = (int32_t)(count < 0 ? -within : within);
    }
}

plumb_design_t plumb_wheels_design(const plumb_wheels_tuning_t *tuning, plumb_params_t *params) {
    plumb_balancer_tuning_t balance = tuning->balance;
    plumb_params_t made;
    balance.period_us = tuning->period_us;
    plumb_design_t d = plumb_balancer_design(&balance, &made);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    made.system = PLUMB_SYSTEM_WHEELS;
    settings_finite(&d, tuning);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    const wide_t dt = wide_div(wide_of((double)tuning->period_us), wide_of(1e6));
    count_words(&d, &tuning->turning, dt, &made.wheels);
    made.wheels.felt_mps_q26 =
        (int32_t)wide_round(wide_mul(wide_mul(wide_product(TAU, GRAVITY_MPS2), dt), wide_of(0x1p26)));
    setting_words(&d, tuning, &made);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
