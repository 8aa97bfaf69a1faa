/* The plant of `wheels` in C: what its files share. The equations, and their order, are those of vehicle.py,
 * plant.py and plumb.physics.imu; units are theirs, too: m, s, rad, N, kg. */
#ifndef PLUMB_WHEELS_PLANT_RIDE_H
#define PLUMB_WHEELS_PLANT_RIDE_H

#include "ports/batch/plant.h"
#include <stdbool.h>

#define AXES           3
#define HAPPENS_ROW    5 /* what, begin_s, end_s, size, number */
#define HAPPENINGS_MAX 24
#define DEG_PER_RAD    (180.0 / 3.14159265358979323846)
#define RAD_PER_DEG    (3.14159265358979323846 / 180.0)
#define TURN_RAD       (2.0 * 3.14159265358979323846)

/* What happens: places of rides.HAPPENINGS; the same bits in the truth, then from FAULTY on those of
 * channels with a fault. */
typedef enum { ICY = 0, OFF, CHATTER, DEAF, KERB, LIFT, PUSH, HAPPENINGS_COUNT } happening_t;
enum { FAULTY = 8 };

/* In the order of .numbers in plant.c. kg, kgm, kgm2, ahead_rad: without and with the rider. */
typedef struct {
    double grid_s, period_us, held_s, frame_s, frame_numbers, full, speed_max_mps, turn_max_dps, by_receiver,
        happenings;
    double slope_rad, supply, gravity_mps2, radius_m, sensor_m, lie_rad, wheel_kgm2, wheels_kg, track_m,
        upright_kgm2;
    double kg[2], kgm[2], kgm2[2], ahead_rad[2];
    double stall_nm, no_load_radps, friction_nm, dead, current_share, grip, ice, kerb_npm, kerb_nspm,
        carry_per_s2, carry_per_s, push_radps2_per_mps2, counts_per_turn, chatter_ms, closed_ms;
    double gyro_unit, gyro_least, gyro_most, accel_unit, accel_least, accel_most, gyro_noise_dps,
        accel_noise_g, warm_up_s, fault_noise_lsb, fault_rail_lsb;
} numbers_t;

/* In the order of .signals in plant.c, which says their shapes. */
enum {
    GYRO_MATRIX = 0,
    GYRO_BIAS_DPS,
    GYRO_WARM_UP_DPS,
    ACCEL_OFFSET_G,
    HAPPENINGS,
    PUSH_RADPS2,
    ASKED_MPS,
    ASKED_DPS,
    WHITE,
    VIBRATION_G,
    FAULT_NOISE
};

/* What acts on the vehicle in a step: plumb.systems.wheels.vehicle.Outside. kerb_side: 0 without a kerb. */
typedef struct {
    double push_radps2, grip[2], kerb_m, kerb_side, lifted_rad;
    bool ridden, held, lifted;
} outside_t;

typedef struct {
    const plant_run_t *run;
    const numbers_t *is;
    double tilt_rad, rate_radps, turning_radps2, velocity_mps, accel_mps2, turn_radps, heading_rad;
    double spin_radps[2], rolled_rad[2], way_m;
    double kerb_m[HAPPENINGS_MAX];
    bool kerb_stands[HAPPENINGS_MAX];
    int32_t step, speed_q15;
    plant_frozen_t frozen;
} vehicle_t;

static inline double clip(double x, double least, double most) {
    return x < least ? least : x > most ? most : x;
}

static inline const double *signal_of(const vehicle_t *v, int32_t which) {
    return v->run->signals[which];
}

/* One step of the physics. duties: NULL while the motors coast. */
void vehicle_advance(vehicle_t *v, const double *duties, const outside_t *now);

/* Slope along the heading. */
double vehicle_slope_rad(const vehicle_t *v);

/* Counts of gyro and accelerometer, x, y, z each, in sample k. */
void ride_six_counts(const vehicle_t *v, int32_t k, double time_s, double counts[2 * AXES]);

/* Bias of the gyro about an axis, deg/s. */
double ride_bias_dps(const vehicle_t *v, int32_t axis, double time_s);

#endif
