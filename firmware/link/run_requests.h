/* Requests that begin a run, end it, disarm its outputs, or keep them armed. Call for an accepted frame of a
 * host that has greeted; each but KEEPALIVE answers its request. */
#ifndef PLUMB_LINK_RUN_REQUESTS_H
#define PLUMB_LINK_RUN_REQUESTS_H

#include "session.h"

void run_requests_begin(session_t *s, const request_t *q);     /* RUN_BEGIN, fresh by a nonce */
void run_requests_end(session_t *s, const request_t *q);       /* RUN_END: disarms first */
void run_requests_disarm(session_t *s, const request_t *q);    /* DISARM */
void run_requests_keepalive(session_t *s, const request_t *q); /* KEEPALIVE: of the run's owner alone */

/* True, with a NACK, while a pilot holds the board armed. Of all requests EXECUTE DISARM alone stops it. ARM
 * would hold the rotors at neutral, and then wait for keep-alives. */
bool run_requests_refused_in_flight(session_t *s, const request_t *q);

#endif
