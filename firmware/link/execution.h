/* CHALLENGE and EXECUTE: the verbs that a host proves fresh by a nonce of the board (nonce.h). Call for an
 * accepted frame of a host that has greeted; each answers its request. */
#ifndef PLUMB_LINK_EXECUTION_H
#define PLUMB_LINK_EXECUTION_H

#include "session.h"

/* Send a nonce for the verb. */
void execution_challenge(session_t *s, const request_t *q);

/* Arm, disarm, save, load, restore the defaults, or enter the bootloader. */
void execution_execute(session_t *s, const request_t *q);

#endif
