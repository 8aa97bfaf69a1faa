/* The controller that knows the truth: plumb.physics.cascade, and what vehicle.py asks of it. */
#include "plant_flight.h"
#include <math.h>

/* The vertical in body axes that the pilot asks for; in mode rate the one that there is. */
static void wanted_vertical(const flight_t *f, double wanted[AXES]) {
    const double roll = f->pilot.lean_rad[0], pitch = f->pilot.lean_rad[1];
    if (f->pilot.turn) {
        for (int32_t i = 0; i < AXES; i++) {
            wanted[i] = f->body.matrix[2][i];
        }
        return;
    }
    wanted[0] = -sin(pitch);
    wanted[1] = sin(roll) * cos(pitch);
    wanted[2] = cos(roll) * cos(pitch);
}

/* Torque about each axis, N m. */
static void ask_torque(flight_t *f, bool flying, double torque[AXES]) {
    const numbers_t *is = f->is;
    const double *up = f->body.matrix[2];
    const double gain[AXES] = {is->rate_gain, is->rate_gain, is->yaw_gain};
    double wanted[AXES];
    wanted_vertical(f, wanted);
    for (int32_t i = 0; i < AXES; i++) {
        const int32_t j = (i + 1) % AXES, k = (i + 2) % AXES;
        const double across = wanted[j] * up[k] - wanted[k] * up[j];
        const double asked = is->attitude_gain * across + f->pilot.yaw_radps * up[i];
        const double error = clip(asked, -is->rate_limit_radps, is->rate_limit_radps) - f->body.rate_radps[i];
        const double sum = f->ideal_sum_rad[i] + (flying ? error * is->period_s : 0.0);
        f->ideal_sum_rad[i] = clip(sum, -is->integral_limit_rad, is->integral_limit_rad);
        torque[i] = signal_of(f, INERTIA)[i] * gain[i] * (error + is->rate_integral * f->ideal_sum_rad[i]);
    }
    const double most = is->yaw_limit * f->pilot.thrust_n * is->moment_m;
    torque[2] = clip(torque[2], -most, most);
}

void ideal_command(flight_t *f, double command[ROTORS]) {
    const numbers_t *is = f->is;
    const bool flying = !(f->pilot.landed_s <= now_s(f));
    double torque[AXES], shares[ROTORS], most = -HUGE_VAL, least = HUGE_VAL;
    for (int32_t i = 0; i < ROTORS; i++) {
        command[i] = 0.0;
    }
    if (now_s(f) < is->rest_s - INSTANT_S) {
        return;
    }
    ask_torque(f, flying, torque);
    for (int32_t i = 0; i < ROTORS; i++) {
        const double *row = &signal_of(f, THRUSTS)[ROTORS * i];
        const double thrust_n =
            row[0] * f->pilot.thrust_n + row[1] * torque[0] + row[2] * torque[1] + row[3] * torque[2];
        shares[i] = thrust_n / (is->thrust_max_n / 4.0);
        most = largest(most, shares[i]);
    }
    for (int32_t i = 0; i < ROTORS; i++) {
        shares[i] -= largest(most - 1.0, 0.0);
        least = shares[i] < least ? shares[i] : least;
    }
    for (int32_t i = 0; flying && i < ROTORS; i++) {
        command[i] = largest(command_for(is, shares[i] + largest(-least, 0.0)), is->idle);
    }
}
