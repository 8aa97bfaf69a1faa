#include "plumb/quad.h"
#include "design/groups.h"

plumb_design_t plumb_quad_design(const plumb_quad_tuning_t *tuning, plumb_params_t *params) {
    const plumb_quad_tuning_t *t = tuning;
    const design_axis_t axis = {t->period_us, t->tilt,   &t->calibration, &t->kalman,
                                &t->trust,    &t->start, &t->pid};
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    plumb_design_axis_finite(&d, &axis);
    DESIGN_FINITE(&d, t, esc.mid_us);
    DESIGN_FINITE(&d, t, esc.span_us);
    DESIGN_FINITE(&d, t, esc.min_us);
    DESIGN_FINITE(&d, t, esc.max_us);
    DESIGN_FINITE(&d, t, esc.neutral_us);
    plumb_design_period(&d, t->period_us);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_QUAD};
    plumb_design_axis(&d, &axis, &made);
    plumb_design_esc(&d, &t->esc, &made.esc);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
