/* The plant of `quadrotor` for batches of runs: its course in time, and the sample of each step. */
#include "plant_flight.h"
#include <math.h>
#include <string.h>

#define OF_SENSORS  6
#define IDLE_HALFUS 2000.0
#define SPAN_HALFUS 2000.0

static bool begun(const double *row, double time_s) {
    return row[1] - INSTANT_S <= time_s;
}

static bool lasts(const double *row, double time_s) {
    return begun(row, time_s) && time_s < row[2] - INSTANT_S;
}

const double *happening_at(const flight_t *f, happening_t what, double time_s) {
    for (int32_t i = (int32_t)f->is->happenings - 1; i >= 0; i--) {
        const double *row = &signal_of(f, HAPPENINGS)[HAPPENS_ROW * i];
        if ((happening_t)row[0] == what && lasts(row, time_s)) {
            return row;
        }
    }
    return NULL;
}

static void begin(void *plant, const plant_run_t *run) {
    flight_t *f = plant;
    memset(f, 0, sizeof *f);
    f->run = run;
    f->is = (const numbers_t *)(const void *)run->numbers;
    memcpy(f->body.attitude, signal_of(f, ATTITUDE), sizeof f->body.attitude);
    memcpy(f->body.position_m, signal_of(f, BEGIN_M), sizeof f->body.position_m);
    matrix_of(f->body.attitude, f->body.matrix);
    memcpy(f->felt_g, f->body.matrix[2], sizeof f->felt_g);
    wind_begin(f);
    pilot_begin(f);
    pilot_now(f);
}

/* Let happen what does in the period from at_s on; gives the share of the full thrust. */
static double happen(flight_t *f, double at_s) {
    const numbers_t *is = f->is;
    body_t *b = &f->body;
    for (int32_t i = 0; i < ROTORS; i++) {
        b->thrust_factor[i] = 1.0;
    }
    for (int32_t i = 0; i < (int32_t)is->happenings; i++) {
        const double *row = &signal_of(f, HAPPENINGS)[HAPPENS_ROW * i];
        if ((happening_t)row[0] == WEAK && lasts(row, at_s)) {
            b->thrust_factor[(int32_t)row[4]] = 1.0 - row[3];
        }
        if ((happening_t)row[0] == KICK && lasts(row, at_s)) {
            b->rate_radps[0] += row[3] * is->period_s / (row[2] - row[1]);
        }
    }
    const double *shaken = happening_at(f, SHAKE, at_s), *sags = happening_at(f, SAG, at_s);
    b->vibration_g = shaken ? shaken[3] : is->vibration_g;
    if (!sags) {
        return is->supply;
    }
    const double since = (at_s - sags[1]) / is->sag_s;
    return is->supply * (1.0 - sags[3] * (since < 1.0 ? since : 1.0));
}

/* The stand lets go of a body whose rotors turn as in a hover. */
static void spin_up(flight_t *f, double command[ROTORS]) {
    for (int32_t i = 0; i < ROTORS; i++) {
        f->body.rotor_radps[i] = f->is->hover_radps;
        f->body.phase_rad[i] = signal_of(f, PHASE_RAD)[i];
        command[i] = f->is->hover_command;
        for (int32_t late = 0; late <= DELAY_STEPS; late++) {
            f->waiting[late][i] = f->is->hover_command;
        }
    }
}

static void fly(flight_t *f, double at_s, double command[ROTORS]) {
    const numbers_t *is = f->is;
    const int32_t sub_steps = (int32_t)is->sub_steps;
    double wind_mps[AXES], force[AXES] = {0.0}, rate[AXES] = {0.0};
    if (at_s < is->rest_s + is->period_s / 2.0 && is->lands == 0.0) {
        spin_up(f, command);
    }
    wind_now(f, at_s, wind_mps);
    const double supply = happen(f, at_s);
    for (int32_t n = 0; n < sub_steps; n++) {
        double target[ROTORS], felt[AXES];
        memmove(f->waiting[0], f->waiting[1], DELAY_STEPS * sizeof f->waiting[0]);
        memcpy(f->waiting[DELAY_STEPS], command, sizeof f->waiting[0]);
        for (int32_t i = 0; i < ROTORS; i++) {
            const double share = share_of(is, clip(f->waiting[0][i], 0.0, 1.0)) * supply;
            target[i] = is->speed_max_radps * sqrt(share);
        }
        body_advance(f, target, wind_mps, felt);
        for (int32_t i = 0; i < AXES; i++) {
            force[i] += felt[i];
            rate[i] += f->body.rate_radps[i];
        }
    }
    for (int32_t i = 0; i < AXES; i++) {
        f->felt_dps[i] = rate[i] * DEG_PER_RAD / sub_steps;
        f->felt_g[i] = force[i] / (is->gravity_mps2 * sub_steps);
    }
}

static void follow(void *plant, double time_s, const int32_t *outputs) {
    flight_t *f = plant;
    const numbers_t *is = f->is;
    const int32_t until = (int32_t)rint(time_s / is->period_s);
    while (f->step < until) {
        double command[ROTORS];
        for (int32_t i = 0; i < ROTORS; i++) {
            command[i] = outputs ? clip((outputs[i] - IDLE_HALFUS) / SPAN_HALFUS, 0.0, 1.0) : 0.0;
        }
        if (is->ideal != 0.0) {
            ideal_command(f, command);
        }
        const double at_s = now_s(f);
        f->step++;
        wind_advance(f);
        if (at_s >= is->rest_s - INSTANT_S && is->held == 0.0) {
            fly(f, at_s, command);
        }
        pilot_now(f);
    }
}

static double happening_bits(const flight_t *f) {
    uint32_t bits = 0;
    const double at_s = now_s(f);
    for (happening_t what = CUT; what <= THROTTLE; what++) {
        bits |= happening_at(f, what, at_s) ? 1U << what : 0U;
    }
    for (int32_t i = 0; i < f->run->fault_count; i++) {
        const plant_fault_t *fault = &f->run->faults[i];
        if (fault->start_s <= at_s && at_s < fault->stop_s) {
            bits |= fault->channel < AXES ? GYRO_LIES : ACCEL_LIES;
        }
    }
    for (int32_t i = 0; i < (int32_t)f->is->happenings; i++) {
        bits += begun(&signal_of(f, HAPPENINGS)[HAPPENS_ROW * i], at_s) ? BEGUN : 0U;
    }
    return bits;
}

static void write_truth(const flight_t *f, double truth[]) {
    const numbers_t *is = f->is;
    const body_t *b = &f->body;
    const double *up = b->matrix[2], above_m = dot(signal_of(f, NORMAL), b->position_m) - is->leg_down_m;
    for (int32_t i = 0; i < AXES; i++) {
        truth[i] = up[i];
        truth[AXES + i] = b->rate_radps[i] * DEG_PER_RAD;
    }
    imu_bias(f, &truth[2 * AXES]);
    truth[9] = acos(clip(up[2], -1.0, 1.0)) * DEG_PER_RAD;
    truth[10] = f->pilot.lean_rad[0] * DEG_PER_RAD;
    truth[11] = f->pilot.lean_rad[1] * DEG_PER_RAD;
    truth[12] = b->position_m[2];
    truth[13] = is->lands != 0.0 ? above_m : b->position_m[2];
    truth[14] = b->pressed_n / is->weight_n;
    truth[15] = b->velocity_mps[2];
    truth[16] = sqrt(dot(b->velocity_mps, b->velocity_mps));
    truth[17] = happening_bits(f);
}

static void sample(void *plant, int32_t k, double time_s, int16_t *counts, double *truth) {
    flight_t *f = plant;
    imu_counts(f, counts);
    plant_fail(f->run, &f->frozen, time_s, counts, &signal_of(f, FAULT_NOISE)[k], f->is->fault_noise_lsb,
               f->is->fault_rail_lsb);
    memcpy(counts + OF_SENSORS, f->pilot.commands, sizeof f->pilot.commands);
    write_truth(f, truth);
}

static int32_t setpoint(const void *plant) {
    const flight_t *f = plant;
    return f->pilot.throttle_q15;
}

extern const plant_t plumb_plant_quadrotor;
__attribute__((visibility("default"))) const plant_t plumb_plant_quadrotor = {
    .numbers =
        "period_s,sub_step_s,sub_steps,rest_s,acts_s,sag_s,"
        "mass_kg,thrust_ns2,speed_max_radps,rotor_drag_kg,rolling_moment_kgm,rises,falls,drag_kgpm,drag_"
        "above_m,"
        "hover_radps,hover_command,thrust_max_n,weight_n,"
        "gravity_mps2,thrust_square,thrust_linear,tiny_rad,"
        "lands,reach_m,leg_spring_npm,leg_damper_nspm,leg_down_m,friction,creep_mps,"
        "wind_mps,east,north,"
        "gyro_unit,gyro_least,gyro_most,accel_unit,accel_least,accel_most,gyro_noise_dps,accel_noise_g,warm_"
        "up_s,"
        "held,vibration_g,supply,climb_m,climb_mps,sink_mps,land_at_s,touched_m,keeps_on_s,"
        "pilot,lean_roll_rad,lean_pitch_rad,lean_yaw_radps,lean_until_s,seen_steps,lean_max_rad,place_per_s2,"
        "speed_per_s,place_sum_per_s3,place_sum_most_ms,sticks_rad,sticks_every_s,shuttle_rad,shuttle_s,"
        "height_per_s2,climb_per_s,height_sum_per_s3,height_sum_most_ms,thrust_most_n,"
        "frame_s,frame_numbers,full,stick_lean,stick_rate_dps,stick_yaw_dps,"
        "ideal,attitude_gain,rate_gain,yaw_gain,rate_integral,rate_limit_radps,integral_limit_rad,yaw_limit,"
        "moment_m,idle,"
        "turns,happenings,fault_noise_lsb,fault_rail_lsb",
    /* inertia (3), torques by thrusts (3, 4), thrusts by collective and torques (4, 4), legs (4, 3), normal
     * of the ground (3), attitude (4), begin (3), phases (4); of the gusts: what their filters hold (5),
     * their shares (3) and their new parts (3); gyro (3, 3), (3), (3); accelerometer (3); turns and
     * happenings, a row each; sticks (times, 2); noise (steps, 9); of faults (6, steps). */
    .signals = "inertia,torques,thrusts,legs,normal,attitude,begin_m,phase_rad,gusts_kept,gusts_share,gusts_"
               "new,gyro_matrix,"
               "gyro_bias_dps,gyro_warm_up_dps,accel_offset_g,turns,happenings,sticks,noise,fault_noise",
    .truth = "up_x,up_y,up_z,rate_x_dps,rate_y_dps,rate_z_dps,bias_x_dps,bias_y_dps,bias_z_dps,lean_deg,"
             "asked_roll_deg,asked_pitch_deg,height_m,clear_m,pressed,climb_mps,speed_mps,happening",
    .bytes = sizeof(flight_t),
    .truths = 18,
    .begin = begin,
    .follow = follow,
    .sample = sample,
    .setpoint = setpoint,
};
