/* The plant of `balancer` for batches of runs: the equations, and their order, of vehicle.py, plant.py and
 * drawn_run.py. */
#include "ports/batch/plant.h"
#include <math.h>

#define RAD_TO_DEG (180.0 / 3.14159265358979323846)

typedef struct {
    double open_loop, grid_s;
    double gravity_mps2, pendulum_m, sensor_height_m, wheel_radius_m, edge_m, lie_rad;
    double moment_kgm, inertia_kgm2, mass_kg, stall_nm, no_load_radps, friction_nm;
    double ideal_per_rad, ideal_per_radps, ideal_per_mps, ideal_limit_mps2;
    double push_radps2_per_mps2, disturbance_keep, disturbance_new;
    double scale, offset_x_g, offset_z_g, dps_per_g, gyro_lsb_per_dps, accel_g_per_lsb, accel_range_lsb;
    double fault_noise_lsb, fault_rail_lsb;
} numbers_t;

enum {
    HAND_RAD = 0,
    HELD,
    COMMAND_MPS,
    PUSH_MPS2,
    DISTURBANCE,
    BIAS_DPS,
    VIBRATION_G,
    ACCEL_NOISE_LSB,
    GYRO_NOISE_DPS,
    FAULT_NOISE
};

typedef struct {
    const plant_run_t *run;
    const numbers_t *is;
    double tilt_rad, rate_radps, turning_radps2, way_m, velocity_mps, accel_mps2, disturbance;
    int32_t step;
    plant_frozen_t frozen;
} vehicle_t;

static double clip(double x, double least, double most) {
    return x < least ? least : x > most ? most : x;
}

static void begin(void *plant, const plant_run_t *run) {
    vehicle_t *v = plant;
    *v = (vehicle_t){.run = run, .is = (const numbers_t *)(const void *)run->numbers};
    v->tilt_rad = run->signals[HAND_RAD][0];
}

static void follow_hand(vehicle_t *v, int32_t at) {
    const double *hand_rad = v->run->signals[HAND_RAD], grid_s = v->is->grid_s;
    const int32_t last = v->run->points - 1;
    const double before = hand_rad[at < last ? at : last], now = hand_rad[at + 1 < last ? at + 1 : last];
    const double after = hand_rad[at + 2 < last ? at + 2 : last];
    v->tilt_rad = now;
    v->rate_radps = (after - before) / (2.0 * grid_s);
    v->turning_radps2 = (after - 2.0 * now + before) / pow(grid_s, 2.0);
    v->velocity_mps = v->accel_mps2 = 0.0;
}

static void prescribe(vehicle_t *v, double command_mps, double kick_radps2) {
    const numbers_t *is = v->is;
    const double wanted = is->ideal_per_rad * v->tilt_rad + is->ideal_per_radps * v->rate_radps +
                          is->ideal_per_mps * (v->velocity_mps - command_mps);
    const double accel = clip(wanted, -is->ideal_limit_mps2, is->ideal_limit_mps2);
    const double fall = is->gravity_mps2 * sin(v->tilt_rad) - accel * cos(v->tilt_rad);
    v->accel_mps2 = accel;
    v->turning_radps2 = fall / is->pendulum_m + kick_radps2;
}

/* duty: NULL for an open bridge. */
static void drive(vehicle_t *v, const double *duty, double kick_radps2) {
    const numbers_t *is = v->is;
    const double spin = v->velocity_mps / is->wheel_radius_m - v->rate_radps;
    const double pull = duty ? is->stall_nm * (*duty - spin / is->no_load_radps) : 0.0;
    const double torque = pull - is->friction_nm * tanh(spin / 0.5);
    const double sine = sin(v->tilt_rad), cosine = cos(v->tilt_rad);
    const double coupling = is->moment_kgm * cosine;
    const double along = is->moment_kgm * sine * pow(v->rate_radps, 2.0) + torque / is->wheel_radius_m;
    const double about = is->moment_kgm * is->gravity_mps2 * sine - torque + is->inertia_kgm2 * kick_radps2;
    const double determinant = is->mass_kg * is->inertia_kgm2 - coupling * coupling;
    v->accel_mps2 = (is->inertia_kgm2 * along - coupling * about) / determinant;
    v->turning_radps2 = (is->mass_kg * about - coupling * along) / determinant;
}

static void advance(vehicle_t *v, const double *duty) {
    const numbers_t *is = v->is;
    const double *const *of = v->run->signals;
    const int32_t at = v->step % v->run->points;
    v->step++;
    v->disturbance = is->disturbance_keep * v->disturbance + is->disturbance_new * of[DISTURBANCE][at];
    if (of[HELD][at] != 0.0) {
        follow_hand(v, at);
        return;
    }
    const double kick_radps2 = is->push_radps2_per_mps2 * of[PUSH_MPS2][at] + v->disturbance;
    if (is->open_loop != 0.0) {
        prescribe(v, of[COMMAND_MPS][at], kick_radps2);
    } else {
        drive(v, duty, kick_radps2);
    }
    v->rate_radps += v->turning_radps2 * is->grid_s;
    v->tilt_rad += v->rate_radps * is->grid_s;
    v->velocity_mps += v->accel_mps2 * is->grid_s;
    v->way_m += v->velocity_mps * is->grid_s;
    if (fabs(v->tilt_rad) > is->lie_rad) {
        v->tilt_rad = copysign(is->lie_rad, v->tilt_rad);
        v->rate_radps = 0.0;
    }
}

static void follow(void *plant, double time_s, const int32_t *outputs) {
    vehicle_t *v = plant;
    const double duty = outputs ? outputs[0] / 32768.0 : 0.0;
    const int32_t until = (int32_t)floor(time_s / v->is->grid_s + 1e-6);
    while (v->step < until) {
        advance(v, outputs ? &duty : NULL);
    }
}

static void force_g(const vehicle_t *v, double force[2]) {
    const numbers_t *is = v->is;
    const double sine = sin(v->tilt_rad), cosine = cos(v->tilt_rad);
    const double square = v->rate_radps * v->rate_radps;
    const double along = v->accel_mps2 + is->sensor_height_m * (v->turning_radps2 * cosine - square * sine);
    const double up = is->gravity_mps2 - is->sensor_height_m * (v->turning_radps2 * sine + square * cosine);
    force[0] = (along * cosine - up * sine) / is->gravity_mps2;
    force[1] = (along * sine + up * cosine) / is->gravity_mps2;
}

static void sample(void *plant, int32_t k, double time_s, int16_t *counts, double *truth) {
    vehicle_t *v = plant;
    const numbers_t *is = v->is;
    const double *const *of = v->run->signals;
    const int32_t steps = v->run->steps;
    const double rate_dps = v->rate_radps * RAD_TO_DEG, offset_g[2] = {is->offset_x_g, is->offset_z_g};
    double shaken_g[2];
    force_g(v, shaken_g);
    for (int32_t i = 0; i < 2; i++) {
        shaken_g[i] += of[VIBRATION_G][i * steps + k];
    }
    const double gyro_dps =
        is->scale * rate_dps + of[BIAS_DPS][k] + is->dps_per_g * shaken_g[0] + of[GYRO_NOISE_DPS][k];
    counts[0] = (int16_t)clip(rint(gyro_dps * is->gyro_lsb_per_dps), -32768.0, 32767.0);
    for (int32_t i = 0; i < 2; i++) {
        const double accel_g =
            shaken_g[i] + offset_g[i] + is->accel_g_per_lsb * of[ACCEL_NOISE_LSB][i * steps + k];
        const double lsb = rint(accel_g / is->accel_g_per_lsb);
        counts[1 + i] = (int16_t)clip(lsb, -is->accel_range_lsb, is->accel_range_lsb - 1.0);
    }
    const double edges = floor((v->way_m - is->wheel_radius_m * v->tilt_rad) / is->edge_m);
    counts[3] = (int16_t)(uint16_t)(int64_t)edges;
    plant_fail(v->run, &v->frozen, time_s, counts, &of[FAULT_NOISE][k], is->fault_noise_lsb,
               is->fault_rail_lsb);
    truth[0] = v->tilt_rad * RAD_TO_DEG;
    truth[1] = of[BIAS_DPS][k];
    truth[2] = rate_dps;
    truth[3] = v->velocity_mps;
}

extern const plant_t plumb_plant_balancer;
__attribute__((visibility("default"))) const plant_t plumb_plant_balancer = {
    .numbers =
        "open_loop,grid_s,gravity_mps2,pendulum_m,sensor_height_m,wheel_radius_m,edge_m,lie_rad,moment_kgm,"
        "inertia_kgm2,mass_kg,stall_nm,no_load_radps,friction_nm,ideal_per_rad,ideal_per_radps,ideal_per_mps,"
        "ideal_limit_mps2,push_radps2_per_mps2,disturbance_keep,disturbance_new,scale,offset_x_g,offset_z_g,"
        "dps_per_g,gyro_lsb_per_dps,accel_g_per_lsb,accel_range_lsb,fault_noise_lsb,fault_rail_lsb",
    .signals =
        "hand_rad,held,command_mps,push_mps2,disturbance,bias_dps,vibration_g,accel_noise_lsb,gyro_noise_dps,"
        "fault_noise",
    .truth = "tilt_deg,bias_dps,rate_dps,velocity_mps",
    .bytes = sizeof(vehicle_t),
    .truths = 4,
    .begin = begin,
    .follow = follow,
    .sample = sample,
};
