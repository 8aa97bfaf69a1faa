/* Check words over guarded memory, as in ports/stm32f103/guard.c. The linker provides start and end of
 * sections whose names are C identifiers. Between their objects are the sanitizer's red zones, which only the
 * loops here may read. */
#include "port.h"

extern uint8_t __start_guarded[], __stop_guarded[];
extern uint8_t __start_guarded_parameters[], __stop_guarded_parameters[];

#define UNCHECKED __attribute__((no_sanitize("address"), noinline))
#define FNV_START 14695981039346656037U
#define FNV_PRIME 1099511628211U

static uint64_t state_word, parameters_word;
static bool released, upset, clock_upset;

/* FNV-1a: every flipped bit changes it. */
UNCHECKED static uint64_t word_of(const uint8_t *from, const uint8_t *end) {
    uint64_t hash = FNV_START;
    for (const uint8_t *byte = from; byte < end; byte++) {
        hash = (hash ^ *byte) * FNV_PRIME;
    }
    return hash;
}

UNCHECKED static void clear(uint8_t *from, const uint8_t *end) {
    for (volatile uint8_t *byte = from; byte < end; byte++) {
        *byte = 0U;
    }
}

void guard_reset(void) {
    clear(__start_guarded, __stop_guarded);
    clear(__start_guarded_parameters, __stop_guarded_parameters);
    released = upset = clock_upset = false;
}

void guard_clock_upset(void) {
    clock_upset = true;
}

bool board_memory_intact(void) {
    const bool intact =
        !clock_upset &&
        (released || (word_of(__start_guarded, __stop_guarded) == state_word &&
                      word_of(__start_guarded_parameters, __stop_guarded_parameters) == parameters_word));
    clock_upset = false;
    upset = upset || !intact;
    return intact;
}

void board_memory_seal(void) {
    state_word = word_of(__start_guarded, __stop_guarded);
    released = false;
}

void board_memory_release(void) {
    released = true;
}

void board_parameters_seal(void) {
    parameters_word = word_of(__start_guarded_parameters, __stop_guarded_parameters);
}

uint32_t guard_faults(void) {
    return upset ? BOARD_FAULT_UPSET : 0U;
}

size_t native_guarded_bytes(void) {
    return (size_t)(__stop_guarded - __start_guarded) +
           (size_t)(__stop_guarded_parameters - __start_guarded_parameters);
}

UNCHECKED void native_flip(size_t at, uint32_t bit) {
    const size_t first = (size_t)(__stop_guarded - __start_guarded);
    uint8_t *const byte = at < first ? __start_guarded + at : __start_guarded_parameters + (at - first);
    *byte = (uint8_t)(*byte ^ 1U << bit);
}
