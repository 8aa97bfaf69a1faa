/* Requests for the table of parameters in use; staging.h has those for the staged one. Call for an accepted
 * frame of a host that has greeted; each answers its request. */
#ifndef PLUMB_LINK_TABLE_REQUESTS_H
#define PLUMB_LINK_TABLE_REQUESTS_H

#include "session.h"

/* PARAM_GET: one row, or the whole table. */
void table_requests_get(session_t *s, const request_t *q);

/* PARAM_COMMIT: put the staged table into use, unless the run that is on forbids it. */
void table_requests_commit(session_t *s, const request_t *q);

#endif
