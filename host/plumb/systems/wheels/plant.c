/* The plant of `wheels` for batches of runs: what happens in a ride, and the sample of each step. */
#include "plant_ride.h"
#include <math.h>
#include <string.h>

#define MOTORS_ON 1

static const double *row_of(const vehicle_t *v, int32_t place) {
    return &signal_of(v, HAPPENINGS)[HAPPENS_ROW * place];
}

static bool lasts(const double *row, double time_s) {
    return row[1] <= time_s && time_s < row[2];
}

/* The last of a kind that lasts; NULL: there is none. */
static const double *happening(const vehicle_t *v, happening_t what, double time_s) {
    for (int32_t i = (int32_t)v->is->happenings - 1; i >= 0; i--) {
        if ((happening_t)row_of(v, i)[0] == what && lasts(row_of(v, i), time_s)) {
            return row_of(v, i);
        }
    }
    return NULL;
}

static bool ridden(const vehicle_t *v, double time_s) {
    return !happening(v, OFF, time_s) && !happening(v, CHATTER, time_s);
}

static bool closed(const vehicle_t *v, double time_s) {
    const double *chatters = happening(v, CHATTER, time_s);
    if (!chatters) {
        return ridden(v, time_s);
    }
    const int32_t since_ms = (int32_t)((time_s - chatters[1]) * 1000.0 + 1e-6) + (int32_t)chatters[4];
    return since_ms % (int32_t)v->is->chatter_ms < (int32_t)v->is->closed_ms;
}

/* Bits of the wheels on ice. */
static uint32_t icy_wheels(const vehicle_t *v, double time_s) {
    uint32_t icy = 0;
    for (int32_t i = 0; i < (int32_t)v->is->happenings; i++) {
        if ((happening_t)row_of(v, i)[0] == ICY && lasts(row_of(v, i), time_s)) {
            icy |= (uint32_t)row_of(v, i)[4];
        }
    }
    return icy;
}

static outside_t outside(vehicle_t *v, double time_s) {
    const numbers_t *is = v->is;
    outside_t now = {.push_radps2 = signal_of(v, PUSH_RADPS2)[v->step % v->run->points]};
    const uint32_t icy = icy_wheels(v, time_s);
    for (int32_t i = 0; i < (int32_t)is->happenings; i++) {
        const double *row = row_of(v, i);
        if (!lasts(row, time_s)) {
            continue;
        }
        if ((happening_t)row[0] == PUSH) {
            now.push_radps2 += is->push_radps2_per_mps2 * row[3];
        } else if ((happening_t)row[0] == KERB) {
            if (!v->kerb_stands[i]) {
                v->kerb_m[i] = v->way_m;
            }
            v->kerb_stands[i] = true;
            now.kerb_m = v->kerb_m[i];
            now.kerb_side = row[4];
        } else if ((happening_t)row[0] == LIFT) {
            now.lifted = true;
            now.lifted_rad = row[3] * RAD_PER_DEG;
        }
    }
    for (int32_t i = 0; i < 2; i++) {
        now.grip[i] = icy >> i & 1U ? is->ice : is->grip;
    }
    now.ridden = ridden(v, time_s);
    now.held = time_s < is->held_s;
    return now;
}

static int32_t sample_at(const vehicle_t *v, double time_s) {
    return (int32_t)(time_s * 1e6 / v->is->period_us + 1e-6) % v->run->steps;
}

/* Number of the receiver's newest frame; 0: it is not in use. */
static int32_t newest_frame(const vehicle_t *v, double time_s) {
    if (v->is->by_receiver == 0.0) {
        return 0;
    }
    const double *deaf = happening(v, DEAF, time_s);
    return (int32_t)((deaf ? deaf[1] : time_s) / v->is->frame_s + 1e-6) + 1;
}

static void begin(void *plant, const plant_run_t *run) {
    vehicle_t *v = plant;
    memset(v, 0, sizeof *v);
    v->run = run;
    v->is = (const numbers_t *)(const void *)run->numbers;
}

static void follow(void *plant, double time_s, const int32_t *outputs) {
    vehicle_t *v = plant;
    const int32_t until = (int32_t)floor(time_s / v->is->grid_s + 1e-6);
    while (v->step < until) {
        double duties[2];
        for (int32_t i = 0; i < 2; i++) {
            duties[i] = outputs ? outputs[i] / 32768.0 : 0.0;
        }
        const outside_t now = outside(v, v->step * v->is->grid_s);
        vehicle_advance(v, outputs ? duties : NULL, &now);
        v->step++;
    }
}

static void command(vehicle_t *v, double time_s, int16_t *commands) {
    const numbers_t *is = v->is;
    const int32_t frame = newest_frame(v, time_s),
                  at = sample_at(v, frame ? (frame - 1) * is->frame_s : time_s);
    const double speed = is->full * signal_of(v, ASKED_MPS)[at] / is->speed_max_mps;
    commands[0] = 0;
    commands[1] = frame ? (int16_t)rint(speed) : 0;
    commands[2] = (int16_t)rint(is->full * signal_of(v, ASKED_DPS)[at] / is->turn_max_dps);
    commands[3] = frame ? MOTORS_ON : 0;
    commands[4] = frame ? (int16_t)((frame - 1) % (int32_t)is->frame_numbers + 1) : 0;
    commands[5] = 0;
    const double asked_mps = signal_of(v, ASKED_MPS)[sample_at(v, time_s)];
    v->speed_q15 = frame ? 0 : (int32_t)rint(is->full * asked_mps / is->speed_max_mps);
}

static double happening_bits(const vehicle_t *v, double time_s) {
    uint32_t bits = 0;
    for (happening_t what = ICY; what < HAPPENINGS_COUNT; what++) {
        bits |= happening(v, what, time_s) ? 1U << what : 0U;
    }
    for (int32_t i = 0; i < v->run->fault_count; i++) {
        const plant_fault_t *fault = &v->run->faults[i];
        if (fault->start_s <= time_s && time_s < fault->stop_s) {
            bits |= 1U << (FAULTY + (int32_t)fault->channel);
        }
    }
    return bits;
}

static void sample(void *plant, int32_t k, double time_s, int16_t *counts, double *truth) {
    vehicle_t *v = plant;
    static const int32_t taken[] = {1, 3, 5, 2};
    double six[2 * AXES];
    const int32_t at = sample_at(v, time_s);
    ride_six_counts(v, at, time_s, six);
    for (int32_t i = 0; i < 4; i++) {
        counts[i] = (int16_t)six[taken[i]];
    }
    for (int32_t i = 0; i < 2; i++) {
        counts[4 + i] =
            (int16_t)(uint16_t)(int64_t)floor(v->rolled_rad[i] / TURN_RAD * v->is->counts_per_turn);
    }
    counts[6] = closed(v, time_s) ? 1 : 0;
    plant_fail(v->run, &v->frozen, time_s, counts, &signal_of(v, FAULT_NOISE)[k], v->is->fault_noise_lsb,
               v->is->fault_rail_lsb);
    counts[7] = counts[8] = 0;
    command(v, time_s, &counts[9]);
    truth[0] = v->tilt_rad * DEG_PER_RAD;
    truth[1] = ride_bias_dps(v, 1, time_s);
    truth[2] = v->rate_radps * DEG_PER_RAD;
    truth[3] = v->velocity_mps;
    truth[4] = v->turn_radps * DEG_PER_RAD;
    truth[5] = signal_of(v, ASKED_MPS)[at];
    truth[6] = signal_of(v, ASKED_DPS)[at];
    truth[7] = happening_bits(v, time_s);
    truth[8] = icy_wheels(v, time_s);
    truth[9] = vehicle_slope_rad(v) * DEG_PER_RAD;
}

static int32_t setpoint(const void *plant) {
    const vehicle_t *v = plant;
    return v->speed_q15;
}

extern const plant_t plumb_plant_wheels;
__attribute__((visibility("default"))) const plant_t plumb_plant_wheels = {
    .numbers =
        "grid_s,period_us,held_s,frame_s,frame_numbers,full,speed_max_mps,turn_max_dps,by_receiver,"
        "happenings,"
        "slope_rad,supply,gravity_mps2,radius_m,sensor_m,lie_rad,wheel_kgm2,wheels_kg,track_m,upright_kgm2,"
        "kg_alone,kg,kgm_alone,kgm,kgm2_alone,kgm2,ahead_alone_rad,ahead_rad,"
        "stall_nm,no_load_radps,friction_nm,dead,current_share,grip,ice,kerb_npm,kerb_nspm,carry_per_s2,"
        "carry_per_s,push_radps2_per_mps2,counts_per_turn,chatter_ms,closed_ms,"
        "gyro_unit,gyro_least,gyro_most,accel_unit,accel_least,accel_most,gyro_noise_dps,accel_noise_g,"
        "warm_up_s,fault_noise_lsb,fault_rail_lsb",
    /* gyro (3, 3), (3), (3); accelerometer (3); happenings, a row each; on the grid of the physics; samples:
     * asked for (steps) each, noise (steps, 6), vibration (steps, 3), of faults (7, steps). */
    .signals = "gyro_matrix,gyro_bias_dps,gyro_warm_up_dps,accel_offset_g,happenings,push_radps2,asked_mps,"
               "asked_dps,white,vibration_g,fault_noise",
    .truth = "tilt_deg,bias_dps,rate_dps,velocity_mps,turn_dps,asked_mps,asked_dps,happening,icy,slope_deg",
    .bytes = sizeof(vehicle_t),
    .truths = 10,
    .begin = begin,
    .follow = follow,
    .sample = sample,
    .setpoint = setpoint,
};
