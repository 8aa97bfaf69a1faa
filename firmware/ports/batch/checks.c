/* What watches the records of a run (plausibility, takeoff), called over arrays as batch.c has it. */
#include "entry.h"

EXPORT int32_t plumb_takeoff_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                                 uint32_t dt_s_q33, uint32_t *states);
EXPORT int32_t plumb_plausibility_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                                      uint32_t variance_turn2_q56, uint32_t *states);

#define TAKEOFF_WORDS 3

/* The conditions for a takeoff of a run, from the records of its steps: the state after each as 32-bit words,
 * [steps][3]. 0: this system does not fly. */
int32_t plumb_takeoff_run(const uint32_t *params, const uint8_t *words, int32_t steps, uint32_t dt_s_q33,
                          uint32_t *states) {
    const plumb_params_t p = params_of(params);
    control_words_t record;
    plumb_takeoff_t t;
    const plumb_takeoff_bounds_t *const bounds = control_system(&p)->takeoff;
    if (bounds == NULL) {
        return 0;
    }
    plumb_takeoff_init(&t);
    for (int32_t k = 0; k < steps; k++) {
        memcpy(&record, words + (size_t)k * control_words_bytes(&p), control_words_bytes(&p));
        plumb_takeoff_step(&t, bounds, &record, dt_s_q33);
        const uint32_t now[TAKEOFF_WORDS] = {t.ready_s_q33, t.rate_mean_turnps_q28, t.missing};
        memcpy(states + (size_t)k * TAKEOFF_WORDS, now, sizeof now);
    }
    return 1;
}

#define PLAUSIBILITY_WORDS 16

/* The plausibility of a run, from the records of its steps: the state after each as 32-bit words,
 * [steps][16]. 0: this system has none to check. */
int32_t plumb_plausibility_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                               uint32_t variance_turn2_q56, uint32_t *states) {
    const plumb_params_t p = params_of(params);
    control_words_t record;
    plumb_plausibility_t s;
    const plumb_plausibility_bounds_t *const bounds = control_system(&p)->plausibility;
    if (bounds == NULL) {
        return 0;
    }
    plumb_plausibility_init(&s);
    for (int32_t k = 0; k < steps; k++) {
        memcpy(&record, words + (size_t)k * control_words_bytes(&p), control_words_bytes(&p));
        plumb_plausibility_step(&s, bounds, &record, p.kalman.dt_s_q33, variance_turn2_q56);
        const uint32_t now[PLAUSIBILITY_WORDS] = {
            s.accel_s_q33,
            s.innovation_s_q33,
            s.rate_s_q33,
            s.converged_s_q33,
            s.ready_s_q33,
            (uint32_t)s.mismatch_turn_q32,
            (uint32_t)s.unevenness_turn_q32,
            (uint32_t)s.measured_turn_q32,
            (uint32_t)s.rate_turnps_q28,
            (uint32_t)s.innovation_turn_q32,
            (uint32_t)s.rate_mean_turnps_q28,
            (uint32_t)s.accel_mean_g2_q20,
            s.begun ? 1U : 0U,
            s.converged ? 1U : 0U,
            s.failed,
            s.missing,
        };
        memcpy(states + (size_t)k * PLAUSIBILITY_WORDS, now, sizeof now);
    }
    return 1;
}
