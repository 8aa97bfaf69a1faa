/* The core as a shared library for Python: the same C as on the target, called over arrays.
 *
 * Every entry point takes pointers to integer arrays and counts. params is plumb_params_t as 32-bit words.
 * Functions named ..._run keep one state over n steps; those named ..._each take n independent states, also
 * states that no run reaches. Arrays of steps and runs are [steps][runs].
 */
#include "core/angle.h"
#include "core/digest.h"
#include "core/kalman.h"
#include "core/pid.h"
#include "core/tilt.h"
#include "generated/record_names.h"
#include "systems/control.h"
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define PARAMS_WORDS (sizeof(plumb_params_t) / sizeof(uint32_t))

EXPORT const char *plumb_word_names(uint32_t system);
EXPORT int32_t plumb_sizeof_words(uint32_t system);
EXPORT int32_t plumb_sizeof_control(void);
EXPORT int32_t plumb_sizeof_kalman(void);
EXPORT int32_t plumb_sizeof_pid(void);
EXPORT int32_t plumb_params_count(void);
EXPORT int32_t plumb_params_valid(const uint32_t *params);
EXPORT void plumb_control_init(void *control, const uint32_t *params);
EXPORT void plumb_control_step(void *control, const uint32_t *params, const int16_t *raw, int32_t setpoint);
EXPORT void plumb_control_retune(void *control, const uint32_t *from, const uint32_t *to);
EXPORT void plumb_control_steps(void *control, const uint32_t *params, const int16_t *raw,
                                const int32_t *setpoint, int32_t steps, uint8_t *words);
EXPORT void plumb_control_each(void *controls, const uint32_t *params, const int16_t *raw,
                               const int32_t *setpoint, int32_t n, uint8_t *words);
EXPORT void plumb_control_words(const void *control, const uint32_t *params, uint8_t *words);
EXPORT void plumb_control_run(const uint32_t *params, const int16_t *raw, const int32_t *setpoint,
                              int32_t steps, uint8_t *words, uint32_t *digests);
EXPORT void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                             const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                             int32_t *fused_turn_q32);
EXPORT void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                              const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32,
                          const int32_t *rate_turnps_q28, int32_t steps, uint8_t *states);
EXPORT void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                           const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_pid_retune_each(const uint32_t *from, const uint32_t *to, void *states, int32_t n);
EXPORT void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32);
EXPORT void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32);
EXPORT void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30);
EXPORT void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half);
EXPORT void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                           int32_t n, int32_t *turn_q32, uint32_t *variance);
EXPORT void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61);
EXPORT int32_t plumb_takeoff_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                                 uint32_t dt_s_q33, uint32_t *states);
EXPORT int32_t plumb_plausibility_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                                      uint32_t variance_turn2_q56, uint32_t *states);
EXPORT uint32_t plumb_crc32(const uint8_t *data, int32_t bytes);

/* The words of a system's step in the order of its record; arrays as name_index. NULL: this core has no such
 * system. */
const char *plumb_word_names(uint32_t system) {
    return record_names(system);
}

int32_t plumb_sizeof_words(uint32_t system) {
    const plumb_params_t p = {.system = system};
    return record_names(system) == NULL ? 0 : (int32_t)control_words_bytes(&p);
}

int32_t plumb_sizeof_control(void) {
    return (int32_t)sizeof(control_t);
}

int32_t plumb_sizeof_kalman(void) {
    return (int32_t)sizeof(plumb_kalman_t);
}

int32_t plumb_sizeof_pid(void) {
    return (int32_t)sizeof(plumb_pid_t);
}

int32_t plumb_params_count(void) {
    return (int32_t)PARAMS_WORDS;
}

static plumb_params_t params_of(const uint32_t *words) {
    plumb_params_t p;
    memcpy(&p, words, sizeof p);
    return p;
}

int32_t plumb_params_valid(const uint32_t *params) {
    const plumb_params_t p = params_of(params);
    return control_params_valid(&p);
}

/* One step at a time, for a closed loop. control: plumb_sizeof_control() bytes, aligned to 8. */
void plumb_control_init(void *control, const uint32_t *params) {
    const plumb_params_t p = params_of(params);
    control_init(control, &p);
}

void plumb_control_step(void *control, const uint32_t *params, const int16_t *raw, int32_t setpoint) {
    const plumb_params_t p = params_of(params);
    control_step(control, &p, raw, setpoint);
}

void plumb_control_retune(void *control, const uint32_t *from, const uint32_t *to) {
    const plumb_params_t before = params_of(from), after = params_of(to);
    control_retune(control, &before, &after);
}

void plumb_control_words(const void *control, const uint32_t *params, uint8_t *words) {
    const plumb_params_t p = params_of(params);
    memcpy(words, control_words(control), control_words_bytes(&p));
}

/* More steps of a run. raw: [steps][inputs of the system]; words: [steps][plumb_sizeof_words(system)]. */
void plumb_control_steps(void *control, const uint32_t *params, const int16_t *raw, const int32_t *setpoint,
                         int32_t steps, uint8_t *words) {
    const plumb_params_t p = params_of(params);
    const size_t bytes = control_words_bytes(&p);
    const size_t inputs = control_system(&p)->inputs;
    for (int32_t i = 0; i < steps; i++) {
        control_step(control, &p, raw + (size_t)i * inputs, setpoint[i]);
        memcpy(words + (size_t)i * bytes, control_words(control), bytes);
    }
}

/* One step of each of n controls, plumb_sizeof_control() bytes apart. raw: [n][inputs of the system];
 * words: [n][plumb_sizeof_words(system)]. */
void plumb_control_each(void *controls, const uint32_t *params, const int16_t *raw, const int32_t *setpoint,
                        int32_t n, uint8_t *words) {
    const plumb_params_t p = params_of(params);
    const size_t bytes = control_words_bytes(&p);
    const size_t inputs = control_system(&p)->inputs;
    control_t *c = controls;
    for (int32_t i = 0; i < n; i++) {
        control_step(&c[i], &p, raw + (size_t)i * inputs, setpoint[i]);
        memcpy(words + (size_t)i * bytes, control_words(&c[i]), bytes);
    }
}

/* A whole run from its start. raw: [steps][inputs of the system]; words: [steps][plumb_sizeof_words(system)],
 * may be NULL; digests: [steps], may be NULL. */
void plumb_control_run(const uint32_t *params, const int16_t *raw, const int32_t *setpoint, int32_t steps,
                       uint8_t *words, uint32_t *digests) {
    const plumb_params_t p = params_of(params);
    const size_t bytes = control_words_bytes(&p);
    const size_t inputs = control_system(&p)->inputs;
    control_t c;
    control_init(&c, &p);
    for (int32_t i = 0; i < steps; i++) {
        control_step(&c, &p, raw + (size_t)i * inputs, setpoint[i]);
        if (words) {
            memcpy(words + (size_t)i * bytes, control_words(&c), bytes);
        }
        if (digests) {
            digests[i] = digest_crc32(control_words(&c), bytes);
        }
    }
}

/* The filter alone: runs filters over steps samples. Inputs and fused are [steps][runs]; states:
 * plumb_kalman_t[runs], initialised here from params; on return the final states. The filters of a step are
 * independent, so the processor can work on several at once. */
void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                      const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                      int32_t *fused_turn_q32) {
    const plumb_params_t p = params_of(params);
    plumb_kalman_t *k = states;
    for (int32_t run = 0; run < runs; run++) {
        plumb_kalman_init(&k[run], &p.start);
    }
    for (int32_t i = 0; i < steps; i++) {
        const size_t at = (size_t)i * (size_t)runs;
        for (int32_t run = 0; run < runs; run++) {
            const size_t j = at + (size_t)run;
            kalman_step(&k[run], &p.kalman, variance[j], tilt_turn_q32[j], rate_turnps_q28[j]);
            fused_turn_q32[j] = kalman_tilt(&k[run]);
        }
    }
}

/* One step of each of n states (plumb_kalman_t). */
void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                       const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n) {
    const plumb_params_t p = params_of(params);
    plumb_kalman_t *k = states;
    for (int32_t i = 0; i < n; i++) {
        kalman_step(&k[i], &p.kalman, variance[i], tilt_turn_q32[i], rate_turnps_q28[i]);
    }
}

/* The controller alone, from its start. states: plumb_pid_t[steps], the state after every step. */
void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32, const int32_t *rate_turnps_q28,
                   int32_t steps, uint8_t *states) {
    const plumb_params_t p = params_of(params);
    plumb_pid_t c;
    plumb_pid_init(&c);
    for (int32_t i = 0; i < steps; i++) {
        pid_step(&c, &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
        memcpy(states + (size_t)i * sizeof c, &c, sizeof c);
    }
}

/* One step of each of n states (plumb_pid_t). */
void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                    const int32_t *rate_turnps_q28, int32_t n) {
    const plumb_params_t p = params_of(params);
    plumb_pid_t *c = states;
    for (int32_t i = 0; i < n; i++) {
        pid_step(&c[i], &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
    }
}

/* Other gains for each of n states (plumb_pid_t). */
void plumb_pid_retune_each(const uint32_t *from, const uint32_t *to, void *states, int32_t n) {
    const plumb_params_t before = params_of(from), after = params_of(to);
    plumb_pid_t *c = states;
    for (int32_t i = 0; i < n; i++) {
        plumb_pid_retune(&c[i], &before.pid, &after.pid);
    }
}

void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = angle_atan2(y[i], x[i]);
    }
}

void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = angle_asin(x_q30[i]);
    }
}

void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30) {
    for (int32_t i = 0; i < n; i++) {
        plumb_angle_sincos(turn_q32[i], &sin_q30[i], &cos_q30[i]);
    }
}

void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half) {
    for (int32_t i = 0; i < n; i++) {
        half[i] = plumb_angle_length(y[i], x[i]);
    }
}

/* Measured tilt and its variance. */
void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                    int32_t n, int32_t *turn_q32, uint32_t *variance) {
    const plumb_params_t p = params_of(params);
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = tilt_angle(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
        variance[i] = tilt_variance(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
    }
}

/* d: 2^30 .. 2^31 - 1 */
void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61) {
    for (int32_t i = 0; i < n; i++) {
        y_q61[i] = reciprocal_q61(d[i]);
    }
}

uint32_t plumb_crc32(const uint8_t *data, int32_t bytes) {
    return digest_crc32(data, (size_t)bytes);
}

#define TAKEOFF_WORDS 3

/* The conditions for a takeoff of a run, from the records of its steps: the state after each as 32-bit words,
 * [steps][3]. 0: this system does not fly. */
int32_t plumb_takeoff_run(const uint32_t *params, const uint8_t *words, int32_t steps, uint32_t dt_s_q33,
                          uint32_t *states) {
    plumb_params_t p;
    control_words_t record;
    plumb_takeoff_t t;

    memcpy(&p, params, sizeof p);
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
    plumb_params_t p;
    control_words_t record;
    plumb_plausibility_t s;

    memcpy(&p, params, sizeof p);
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
