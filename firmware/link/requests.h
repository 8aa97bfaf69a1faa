/* What EXECUTE asks for besides arming: saved parameters, and the way into the ROM bootloader. The session's
 * third part; called by session.c and the main loop. */
#ifndef PLUMB_LINK_REQUESTS_H
#define PLUMB_LINK_REQUESTS_H

#include "session.h"

/* Where the parameters in use come from, as IDENTITY says it. */
#define REQUESTS_FROM_HOST 4U /* committed and not saved; below: store_found_t */

/* What the start found in flash. */
void requests_loaded(session_t *s, const store_report_t *report);

/* The parameters in use are the host's now. */
void requests_committed(session_t *s);

/* Carry out a verb whose nonce was right: 0, or the reason of the NACK. */
uint16_t requests_execute(session_t *s, uint16_t verb, uint32_t now_us);

/* BOARD_FAULT_PARAMETERS, or 0. */
uint32_t requests_faults(const session_t *s);

/* True when the ROM bootloader was asked for, and the answer is out: time to go. */
bool requests_bootloader_due(const session_t *s, uint32_t now_us);

/* A run or arming withdraws the request: a board that is disarmed later must not reset then. */
void requests_withdraw_bootloader(session_t *s);

#endif
