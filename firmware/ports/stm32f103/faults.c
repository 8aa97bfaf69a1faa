/* Fatal errors: processor faults, unexpected interrupts, a failing crystal, a stack overflow.
 *
 * All end the same way: outputs to neutral, a note for the next start, system reset. Nothing on that way
 * trusts memory. */
#include "faults.h"
#include "app/board.h"
#include "linker.h"
#include "pwm.h"
#include "stm32f103.h"

#define NOTE_MAGIC      0x4e4f5445U
#define GUARD_WORDS     8U
#define GUARD_PATTERN   0x5ac35ac3U
#define EXCEPTION_STACK 0U /* there is no exception 0: the guard was overwritten */
#define EXCEPTION_NMI   2U /* the clock security system, and nothing else on this part (RM0008 7.2.7) */

/* Kept over a reset: the start-up code clears .bss and leaves .noinit alone. */
typedef struct {
    uint32_t magic;
    uint32_t exception;
    uint32_t pc;
    uint32_t check; /* xor of the others: after power-up memory holds random values */
} note_t;
static note_t note __attribute__((section(".noinit")));

__attribute__((noreturn)) static void crash(uint32_t exception, uint32_t pc) {
    pwm_crash();
    note = (note_t){NOTE_MAGIC, exception, pc, NOTE_MAGIC ^ exception ^ pc};
    __asm volatile("dsb" ::: "memory");
    SCB_AIRCR = SCB_AIRCR_RESET;
    for (;;) { /* the reset takes a few cycles; should it fail, the watchdog does it */
    }
}

/* frame: where the processor stored r0 to r3, r12, lr, pc, psr, unless the stack itself was at fault. */
__attribute__((noreturn, used)) void fault_found(const uint32_t *frame, uint32_t exception);
void fault_found(const uint32_t *frame, uint32_t exception) {
    const bool stored = frame >= stack_guard && frame + 8 <= ram_end && ((uintptr_t)frame & 3U) == 0U;
    crash(exception, stored ? frame[6] : 0U);
}

__attribute__((naked)) void fault_entry(void) {
    /* Reset the stack pointer first: the fault may be the stack itself. */
    __asm volatile("mrs r0, msp \n"
                   "mrs r1, ipsr \n"
                   "ldr r2, =stack_top \n"
                   "msr msp, r2 \n"
                   "b fault_found \n"
                   ".ltorg");
}

void faults_check_stack(void) {
    for (uint32_t i = 0U; i < GUARD_WORDS; i++) {
        if (stack_guard[i] != GUARD_PATTERN) {
            crash(EXCEPTION_STACK, 0U);
        }
    }
}

uint32_t faults_init(board_identity_t *identity) {
    uint32_t found = 0U;
    for (uint32_t i = 0U; i < GUARD_WORDS; i++) {
        stack_guard[i] = GUARD_PATTERN;
    }
    if (note.magic == NOTE_MAGIC && note.check == (note.magic ^ note.exception ^ note.pc)) {
        found |= note.exception == EXCEPTION_NMI ? BOARD_FAULT_CRYSTAL : BOARD_FAULT_HARD;
        identity->crash_exception = note.exception;
        identity->crash_pc = note.pc;
    }
    note.magic = 0U;
    const uint32_t cause = RCC_CSR;
    identity->reset_cause = cause >> 24;
    if ((cause & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)) != 0U) {
        found |= BOARD_FAULT_WATCHDOG;
    }
    RCC_CSR = cause | RCC_CSR_RMVF; /* else the flags add up over resets (RM0008 7.3.10) */
    return found;
}
