#include "switches.h"
#include "arming_reasons.h"
#include "pilot.h"
#include "stepping.h"

/* Closing the switch while no run is on starts a live run of the system in use. That run ends when it is
 * disarmed, so that the next closing begins with a fresh state. */
static void follow_switch(session_t *s, bool closed, uint32_t now_us) {
    if (!USED_ACTUATORS) {
        return;
    }
    if (arming_switch(&s->arming, closed, now_us) && s->run.mode == RUN_IDLE) {
        session_begin_run(s, MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE,
                          (run_links_t){LINK_NONE, LINK_NONE, LINK_NONE});
    }
    if (s->arming.switch_trying) {
        arming_try_switch(&s->arming, session_arming_blocked(s, s->run.links.owner), ARMING_SWITCH_READY_US,
                          session_hold_us(s), now_us);
    }
    if (s->run.stand_alone && !arming_armed(&s->arming) && !s->arming.switch_trying) {
        run_end(&s->run);
    }
}

void session_follow_switches(session_t *s, bool closed, uint32_t now_us) {
    if (session_has_receiver(s)) {
        session_follow_pilot(s, closed, now_us);
        return;
    }
    follow_switch(s, closed, now_us);
}
