#include "plumb/balancer.h"
#include "design/systems/balancer_settings.h"

#define WHEEL_SPEED_MOST ((int64_t)15 << 26) /* m/s Q26 */
#define EDGES_MOST       32767
#define LEAN_MOST_DEG    22.5

static int32_t most_edges(plumb_design_t *d, int32_t asked, int32_t edge_mps_q26) {
    const int64_t edge = edge_mps_q26, size = edge < 0 ? -edge : edge,
                  fast = size != 0 ? WHEEL_SPEED_MOST / size : EDGES_MOST,
                  most = fast < EDGES_MOST ? fast : EDGES_MOST;
    if (asked < 0 || asked > most) {
        plumb_design_refuse(d, PLUMB_DESIGN_CONTRADICTS, "wheel.edges_max", (double)asked, 0.0, (double)most);
    }
    return asked != 0 ? asked : (int32_t)most;
}

plumb_design_t plumb_balancer_design(const plumb_balancer_tuning_t *tuning, plumb_params_t *params) {
    const plumb_balancer_tuning_t *t = tuning;
    const double lean_max_deg = t->speed.lean_max_deg, tau_s = t->wheel.tau_s;
    const design_axis_t axis = {t->period_us, t->tilt,   &t->calibration, &t->kalman,
                                &t->trust,    &t->start, &t->pid};
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    plumb_design_axis_finite(&d, &axis);
    settings_finite(&d, t);
    plumb_design_period(&d, t->period_us);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_BALANCER};
    plumb_design_axis(&d, &axis, &made);
    if (!(lean_max_deg > 0.0 && lean_max_deg <= LEAN_MOST_DEG)) {
        plumb_design_refuse(&d, PLUMB_DESIGN_OUT_OF_RANGE, "speed.lean_max_deg", lean_max_deg, 0.0,
                            LEAN_MOST_DEG);
        return d;
    }
    const double share = tau_s > 0.0 ? plumb_design_share((double)t->period_us / 1e6 / tau_s) : 1.0;
    setting_words(&d, t, wide_of(plumb_design_bounded(lean_max_deg)), wide_of(share), &made);
    made.wheel.edges_max = most_edges(&d, t->wheel.edges_max, made.wheel.edge_mps_q26);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
