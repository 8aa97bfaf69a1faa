/* Fatal errors: processor faults, unexpected interrupts, a failing crystal, a stack overflow. */
#ifndef PLUMB_STM32F103_FAULTS_H
#define PLUMB_STM32F103_FAULTS_H

#include "app/board.h"

/* Read the note of the last crash into *identity, and set the guard of the stack; returns BOARD_FAULT_HARD,
 * BOARD_FAULT_CRYSTAL and BOARD_FAULT_WATCHDOG as they apply. */
uint32_t faults_init(board_identity_t *identity);

/* Resets the board when the stack has reached its guard. */
void faults_check_stack(void);

/* Handler of every exception that must not occur; does not return. */
void fault_entry(void);

#endif
