/* Shows the host the state of the shipped loop. */
#include "app/loop.h"
#include "link/arming_reasons.h"
#include "link/requests.h"
#include "port.h"

void inside_look(void) {
    const session_t *const s = loop_session();
    native.armed = session_armed(s);
    native.steps = s->run.step;
    native.receive_room = (uint32_t)requests_room(s);
}
