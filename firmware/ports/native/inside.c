/* Compiles the shipped loop into this file, unchanged, so that the host can read its static state. */
#include "app/loop.c"
#include "link/arming_reasons.h"
#include "link/requests.h"
#include "port.h"

void inside_look(void) {
    native.armed = session_armed(&session);
    native.steps = session.run.step;
    native.receive_room = (uint32_t)requests_room(&session);
}
