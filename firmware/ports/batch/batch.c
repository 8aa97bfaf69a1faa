/* The core as a shared library for Python: the same C as on the target, called over arrays.
 *
 * Every entry point takes pointers to integer arrays and counts. params is plumb_params_t as 32-bit words.
 * Functions named ..._run keep one state over n steps; those named ..._each take n independent states, also
 * states that no run reaches. Arrays of steps and runs are [steps][runs]. Here are the steps of systems;
 * blocks.c has the blocks that they are built of, checks.c what watches their records. */
#include "core/digest.h"
#include "entry.h"
#include "generated/record_names.h"

#define PARAMS_WORDS (sizeof(plumb_params_t) / sizeof(uint32_t))

EXPORT const char *plumb_word_names(uint32_t system);
EXPORT int32_t plumb_sizeof_words(uint32_t system);
EXPORT int32_t plumb_sizeof_control(void);
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

int32_t plumb_params_count(void) {
    return (int32_t)PARAMS_WORDS;
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
