#include "stepping.h"
#include "arming_reasons.h"

void session_begin_run(session_t *s, uint16_t run, run_links_t links) {
    s->bootloader_asked = false;
    if (run != MESSAGE_RUN_BEGIN_RUN_LOCKSTEP && session_has_receiver(s)) {
        links.setpoints = LINK_NONE;
    }
#if CONTROL_LEARNS
    s->own_state = run == MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE;
#endif
    run_begin(&s->run, run, links, s->system);
    telemetry_begin(&s->telemetry);
    control_init(s->control, &s->params->control);
    readiness_begin(&s->readiness, s->system);
}

/* The next injected sample: in lockstep one that waits, when its replies have room. */
static bool next_sample(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    const link_t pacer = run_pacer(&s->run);

    if (pacer != LINK_NONE &&
        !(run_sample_waits(&s->run) && telemetry_has_room(&s->telemetry, &s->routing, pacer))) {
        return false;
    }
    run_next_sample(&s->run, s->system->marks_missing, raw, setpoint);
    return true;
}

bool session_take_inputs(session_t *s, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    if (!s->run.live) {
        return next_sample(s, raw, setpoint);
    }
    *setpoint = s->run.setpoint.value;
    setpoint_copy_commands(&s->run.setpoint, raw);
    return true;
}

/* Flags of STEP. saturated: a raw count of that step was outside its range. */
static uint8_t step_flags(const session_t *s, bool saturated) {
    unsigned flags = 0;

    flags |= arming_armed(&s->arming) ? MESSAGE_STEP_ARMED : 0U;
    flags |= s->run.live ? MESSAGE_STEP_LIVE : 0U;
    flags |= saturated ? MESSAGE_STEP_SATURATED : 0U;
    return (uint8_t)flags;
}

void session_send_words(session_t *s) {
    telemetry_send_words(&s->telemetry, &s->routing, control_words(s->control), run_pacer(&s->run));
}

void session_stepped(session_t *s) {
    const plumb_params_t *const params = &s->params->control;
    const bool saturated = control_saturated(s->control, params);

    if (s->run.mode == RUN_REALTIME) {
        setpoint_report(&s->run.setpoint, &s->routing, s->run.links.setpoints, s->run.step);
    }
    readiness_step(&s->readiness, session_checked(s), s->params, control_words(s->control), session_armed(s));
    telemetry_step(&s->telemetry, &s->routing, s->control, params, s->run.step, step_flags(s, saturated));
    run_stepped(&s->run, saturated);
    session_send_words(s);
}

void session_repeat_step(session_t *s, const request_t *q, uint16_t step) {
    telemetry_repeat_step(&s->telemetry, &s->routing, q, step, step_flags(s, false));
}
