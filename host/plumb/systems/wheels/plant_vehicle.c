/* The body of `wheels` on its two wheels, and its sensors: vehicle.py and plumb.physics.imu. */
#include "plant_ride.h"
#include <math.h>

typedef struct {
    double along, about, coupling, mass, inertia;
} terms_t;

static double motor_nm(const numbers_t *is, const double *duty, double spin_radps) {
    double pull = 0.0;
    if (duty) {
        const double driven = fabs(*duty) >= is->dead ? is->supply * *duty : 0.0;
        const double share = driven - spin_radps / is->no_load_radps;
        pull = is->stall_nm * clip(share, -is->current_share, is->current_share);
    }
    return pull - is->friction_nm * tanh(spin_radps / 0.5);
}

double vehicle_slope_rad(const vehicle_t *v) {
    return v->is->slope_rad != 0.0 ? asin(sin(v->is->slope_rad) * cos(v->heading_rad)) : 0.0;
}

static double kerb_n(const vehicle_t *v, const outside_t *now) {
    const double depth_m = (v->way_m - now->kerb_m) * now->kerb_side;
    if (depth_m <= 0.0) {
        return 0.0;
    }
    const double pressed = v->is->kerb_npm * depth_m + v->is->kerb_nspm * (v->velocity_mps * now->kerb_side);
    return -now->kerb_side * (pressed > 0.0 ? pressed : 0.0);
}

static terms_t forces(const vehicle_t *v, const double torque[2], const outside_t *now) {
    const numbers_t *is = v->is;
    const int32_t with = now->ridden ? 1 : 0;
    const double centre = v->tilt_rad + is->ahead_rad[with], slope = vehicle_slope_rad(v);
    const double mass = is->wheels_kg + is->kg[with], whirled = v->rate_radps * v->rate_radps;
    terms_t t;
    t.along = is->kgm[with] * sin(centre + slope) * whirled - mass * is->gravity_mps2 * sin(slope);
    t.about = is->kgm[with] * is->gravity_mps2 * sin(centre) - torque[0] - torque[1] +
              is->kgm2[with] * (now->push_radps2 + v->turn_radps * v->turn_radps * sin(centre) * cos(centre));
    if (now->kerb_side != 0.0) {
        t.along += kerb_n(v, now);
    }
    t.coupling = is->kgm[with] * cos(centre + slope);
    t.mass = mass;
    t.inertia = is->kgm2[with];
    return t;
}

/* Forces of the ground that let both wheels roll after the step, or as much as the ground gives. */
static void hold(const vehicle_t *v, const double torque[2], const terms_t *t, const outside_t *now,
                 double force[2]) {
    const numbers_t *is = v->is;
    const double determinant = t->mass * t->inertia - t->coupling * t->coupling;
    const double free = (t->inertia * t->along - t->coupling * t->about) / determinant;
    const double given = t->inertia / determinant;
    const double half = is->track_m / 2.0, turned = half * half / is->upright_kgm2;
    const double own = is->radius_m * is->radius_m / is->wheel_kgm2 + given + turned, other = given - turned;
    const double weight = t->mass * is->gravity_mps2 * cos(vehicle_slope_rad(v)) / 2.0;
    const double moved =
        t->mass * v->velocity_mps * v->turn_radps * (is->radius_m + t->coupling / t->mass) / is->track_m;
    double wanted[2], most[2];
    for (int32_t i = 0; i < 2; i++) {
        const double side = i ? 1.0 : -1.0;
        const double slip = is->radius_m * v->spin_radps[i] - v->velocity_mps - side * half * v->turn_radps;
        const double load = weight + side * moved;
        wanted[i] = slip / is->grid_s + is->radius_m * torque[i] / is->wheel_kgm2 - free;
        most[i] = now->grip[i] * (load > 0.0 ? load : 0.0);
    }
    const double square = own * own - other * other;
    double left = (own * wanted[0] - other * wanted[1]) / square;
    double right = (own * wanted[1] - other * wanted[0]) / square;
    if (fabs(left) > most[0]) {
        left = copysign(most[0], left);
        right = (wanted[1] - other * left) / own;
    }
    if (fabs(right) > most[1]) {
        right = copysign(most[1], right);
        left = (wanted[0] - other * right) / own;
    }
    force[0] = clip(left, -most[0], most[0]);
    force[1] = clip(right, -most[1], most[1]);
}

static void move(vehicle_t *v, const double torque[2], const double force[2]) {
    const numbers_t *is = v->is;
    v->rate_radps += v->turning_radps2 * is->grid_s;
    v->tilt_rad += v->rate_radps * is->grid_s;
    v->velocity_mps += v->accel_mps2 * is->grid_s;
    v->turn_radps += (force[1] - force[0]) * is->track_m / 2.0 / is->upright_kgm2 * is->grid_s;
    v->heading_rad += v->turn_radps * is->grid_s;
    for (int32_t i = 0; i < 2; i++) {
        v->spin_radps[i] += (torque[i] - is->radius_m * force[i]) / is->wheel_kgm2 * is->grid_s;
        v->rolled_rad[i] += (v->spin_radps[i] - v->rate_radps) * is->grid_s;
    }
    v->way_m += v->velocity_mps * is->grid_s;
    if (fabs(v->tilt_rad) > is->lie_rad) {
        v->tilt_rad = copysign(is->lie_rad, v->tilt_rad);
        v->rate_radps = 0.0;
        v->velocity_mps *= 0.99;
        v->turn_radps *= 0.99;
    }
}

static void carry(vehicle_t *v, const double torque[2], double lifted_rad) {
    const numbers_t *is = v->is;
    const double nothing[2] = {0.0, 0.0};
    v->turning_radps2 = is->carry_per_s2 * (lifted_rad - v->tilt_rad) - is->carry_per_s * v->rate_radps;
    v->accel_mps2 = -is->carry_per_s * v->velocity_mps;
    v->turn_radps -= is->carry_per_s * v->turn_radps * is->grid_s;
    move(v, torque, nothing);
}

void vehicle_advance(vehicle_t *v, const double *duties, const outside_t *now) {
    if (now->held) {
        v->tilt_rad = v->rate_radps = v->turning_radps2 = 0.0;
        v->velocity_mps = v->accel_mps2 = v->turn_radps = 0.0;
        v->spin_radps[0] = v->spin_radps[1] = 0.0;
        return;
    }
    double torque[2], force[2];
    for (int32_t i = 0; i < 2; i++) {
        torque[i] = motor_nm(v->is, duties ? &duties[i] : NULL, v->spin_radps[i] - v->rate_radps);
    }
    if (now->lifted) {
        carry(v, torque, now->lifted_rad);
        return;
    }
    terms_t t = forces(v, torque, now);
    hold(v, torque, &t, now, force);
    t.along += force[0] + force[1];
    const double determinant = t.mass * t.inertia - t.coupling * t.coupling;
    v->accel_mps2 = (t.inertia * t.along - t.coupling * t.about) / determinant;
    v->turning_radps2 = (t.mass * t.about - t.coupling * t.along) / determinant;
    move(v, torque, force);
}

static void feel(const vehicle_t *v, double force_g[AXES], double rate_dps[AXES]) {
    const numbers_t *is = v->is;
    const double sine = sin(v->tilt_rad), cosine = cos(v->tilt_rad), square = v->rate_radps * v->rate_radps;
    const double slope = vehicle_slope_rad(v);
    double along = v->accel_mps2 * cos(slope) + is->sensor_m * (v->turning_radps2 * cosine - square * sine);
    along -= v->turn_radps * v->turn_radps * is->sensor_m * sine;
    const double up = is->gravity_mps2 + v->accel_mps2 * sin(slope) -
                      is->sensor_m * (v->turning_radps2 * sine + square * cosine);
    force_g[0] = (along * cosine - up * sine) / is->gravity_mps2;
    force_g[1] = v->velocity_mps * v->turn_radps / is->gravity_mps2;
    force_g[2] = (along * sine + up * cosine) / is->gravity_mps2;
    rate_dps[0] = -v->turn_radps * sine * DEG_PER_RAD;
    rate_dps[1] = v->rate_radps * DEG_PER_RAD;
    rate_dps[2] = v->turn_radps * cosine * DEG_PER_RAD;
}

double ride_bias_dps(const vehicle_t *v, int32_t axis, double time_s) {
    const double cold = expm1(-time_s / v->is->warm_up_s);
    return signal_of(v, GYRO_BIAS_DPS)[axis] - signal_of(v, GYRO_WARM_UP_DPS)[axis] * cold;
}

void ride_six_counts(const vehicle_t *v, int32_t k, double time_s, double counts[2 * AXES]) {
    const numbers_t *is = v->is;
    const double *white = &signal_of(v, WHITE)[2 * AXES * k], *shaken = &signal_of(v, VIBRATION_G)[AXES * k];
    double force_g[AXES], rate_dps[AXES];
    feel(v, force_g, rate_dps);
    for (int32_t i = 0; i < AXES; i++) {
        const double *row = &signal_of(v, GYRO_MATRIX)[AXES * i];
        const double felt = row[0] * rate_dps[0] + row[1] * rate_dps[1] + row[2] * rate_dps[2];
        const double rate = felt + ride_bias_dps(v, i, time_s) + is->gyro_noise_dps * white[i];
        const double force =
            force_g[i] + shaken[i] + signal_of(v, ACCEL_OFFSET_G)[i] + is->accel_noise_g * white[AXES + i];
        counts[i] = clip(rint(rate / is->gyro_unit), is->gyro_least, is->gyro_most);
        counts[AXES + i] = clip(rint(force / is->accel_unit), is->accel_least, is->accel_most);
    }
}
