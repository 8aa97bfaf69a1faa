/* Check words over the memory that decides the outputs (BOARD_GUARDED, BOARD_GUARDED_PARAMETERS).
 *
 * A check word is the CRC unit's remainder. It detects every flipped bit, every burst of up to 32 bits, and
 * all but one in 2^32 of the other errors. Variables that interrupts write must not lie in this memory:
 * interrupts change them while the loop sleeps. */
#include "guard.h"
#include "app/board.h"
#include "app/board_guard.h"
#include "crc.h"
#include "linker.h"

#define RELEASED 0xc3a5961eU /* the only value of `state` that switches the check off */
#define UPSET    0x5be11d37U

static uint32_t state, state_word, parameters_word;
static uint32_t found;   /* 0: no upset since the start */
static bool clock_upset; /* SysTick found that the clock went backwards; not handled by the loop yet */

void guard_clock_upset(void) {
    clock_upset = true;
}

void guard_outputs_upset(void) {
    found = UPSET;
}

bool board_memory_intact(void) {
    const bool intact =
        !clock_upset && (state == RELEASED ||
                         (crc_of_words(guarded_start, guarded_end) == state_word &&
                          crc_of_words(guarded_parameters_start, guarded_parameters_end) == parameters_word));
    clock_upset = false;
    if (!intact) {
        found = UPSET;
    }
    return intact;
}

void board_memory_seal(void) {
    state_word = crc_of_words(guarded_start, guarded_end);
    state = 0U;
}

void board_memory_release(void) {
    state = RELEASED;
}

void board_parameters_seal(void) {
    parameters_word = crc_of_words(guarded_parameters_start, guarded_parameters_end);
}

uint32_t guard_faults(void) {
    return found != 0U ? BOARD_FAULT_UPSET : 0U;
}
