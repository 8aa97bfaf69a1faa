/* What must not happen: processor faults, unexpected interrupts, a failing crystal, a full stack. */
#ifndef PLUMB_STM32F103_FAULTS_H
#define PLUMB_STM32F103_FAULTS_H

#include "app/board.h"

/* Take over what the last crash left behind; returns BOARD_FAULT_HARD, BOARD_FAULT_CRYSTAL and
 * BOARD_FAULT_WATCHDOG as they apply. */
uint32_t faults_init(board_identity_t *identity);

/* Resets the board when the stack has reached its guard. */
void faults_check_stack(void);

/* Vector of every exception that must not happen; does not return. */
void fault_entry(void);

#endif
