#include "plumb/quadrotor.h"
#include "design/systems/quadrotor_settings.h"

plumb_design_t plumb_quadrotor_design(const plumb_quadrotor_tuning_t *tuning, plumb_params_t *params) {
    plumb_attitude_tuning_t attitude = tuning->attitude;
    plumb_params_t made;
    attitude.period_us = tuning->period_us;
    plumb_design_t d = plumb_attitude_design(&attitude, &made);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    made.system = PLUMB_SYSTEM_QUADROTOR;
    settings_finite(&d, tuning);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    const double dt_s = (double)tuning->period_us * 1e-6, tau_s = tuning->rates.d_tau_s;
    const double alpha = tau_s > 0.0 ? plumb_design_share(dt_s / tau_s) : 1.0;
    setting_words(&d, tuning, wide_of(alpha), &made);
    plumb_design_esc(&d, &tuning->esc, &made.esc);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
