/* The plant of `quadrotor` in C: what its files share. The equations, and their order, are those of
 * vehicle.py and of plumb.physics: quadrotor, ground, wind, imu, pilots.
 *
 * Axes and units are theirs, too: earth z up, body x to the front and y to the left; m, s, rad, N, kg. */
#ifndef PLUMB_QUADROTOR_PLANT_FLIGHT_H
#define PLUMB_QUADROTOR_PLANT_FLIGHT_H

#include "ports/batch/plant.h"
#include <stdbool.h>

#define ROTORS      4
#define AXES        3
#define DELAY_STEPS 2
#define SEEN_MOST   256 /* periods that a pilot sees late, at most: 160 of the shortest period */
#define TURN_ROW    5   /* begin_s, end_s, rates of roll, pitch and yaw in deg/s */
#define HAPPENS_ROW 5   /* what, begin_s, end_s, size, number */
#define INSTANT_S   1e-9
#define DEG_PER_RAD (180.0 / 3.14159265358979323846)
#define TURN_RAD    (2.0 * 3.14159265358979323846)
#define COMMANDS    6

/* What happens: places of courses.HAPPENINGS; the same bits in the truth, then these of faults. */
typedef enum { CUT = 0, DEAF, GUST, WEAK, BIAS, SHAKE, SAG, KICK, THROTTLE } happening_t;
enum { GYRO_LIES = 1 << 9, ACCEL_LIES = 1 << 10, BEGUN = 1 << 11 };

/* How a pilot steers, as compiled_plant.py numbers it. */
typedef enum { LEANING = 0, PLACE, STICKS, SHUTTLE } pilot_t;

/* In the order of .numbers in plant.c. */
typedef struct {
    double period_s, sub_step_s, sub_steps, rest_s, acts_s, sag_s;
    double mass_kg, thrust_ns2, speed_max_radps, rotor_drag_kg, rolling_moment_kgm, rises, falls, drag_kgpm,
        drag_above_m, hover_radps, hover_command, thrust_max_n, weight_n;
    double gravity_mps2, thrust_square, thrust_linear, tiny_rad;
    double lands, reach_m, leg_spring_npm, leg_damper_nspm, leg_down_m, friction, creep_mps;
    double wind_mps, east, north;
    double gyro_unit, gyro_least, gyro_most, accel_unit, accel_least, accel_most, gyro_noise_dps,
        accel_noise_g, warm_up_s;
    double held, vibration_g, supply, climb_m, climb_mps, sink_mps, land_at_s, touched_m, keeps_on_s;
    double pilot, lean_roll_rad, lean_pitch_rad, lean_yaw_radps, lean_until_s, seen_steps, lean_max_rad,
        place_per_s2, speed_per_s, place_sum_per_s3, place_sum_most_ms, sticks_rad, sticks_every_s,
        shuttle_rad, shuttle_s;
    double height_per_s2, climb_per_s, height_sum_per_s3, height_sum_most_ms, thrust_most_n;
    double frame_s, frame_numbers, full, stick_lean, stick_rate_dps, stick_yaw_dps;
    double ideal, attitude_gain, rate_gain, yaw_gain, rate_integral, rate_limit_radps, integral_limit_rad,
        yaw_limit, moment_m, idle;
    double turns, happenings, fault_noise_lsb, fault_rail_lsb;
} numbers_t;

/* In the order of .signals in plant.c, which says their shapes. */
enum {
    INERTIA = 0,
    TORQUES,
    THRUSTS,
    LEGS,
    NORMAL,
    ATTITUDE,
    BEGIN_M,
    PHASE_RAD,
    GUSTS_KEPT,
    GUSTS_SHARE,
    GUSTS_NEW,
    GYRO_MATRIX,
    GYRO_BIAS_DPS,
    GYRO_WARM_UP_DPS,
    ACCEL_OFFSET_G,
    TURNS,
    HAPPENINGS,
    STICKS_DRAWN,
    NOISE,
    FAULT_NOISE
};

typedef struct {
    double attitude[4], matrix[AXES][AXES], position_m[AXES], velocity_mps[AXES], rate_radps[AXES];
    double rotor_radps[ROTORS], phase_rad[ROTORS], thrust_factor[ROTORS], vibration_g, pressed_n;
} body_t;

typedef struct {
    double seen_m[SEEN_MOST][AXES], seen_mps[SEEN_MOST][AXES];
    int32_t seen;
    double sum_ms[2], height_sum_ms, lean_rad[2], yaw_radps, thrust_n, received_s, landed_s;
    const double *turn; /* a row of TURNS, NULL in mode level */
    int16_t commands[COMMANDS];
    int32_t throttle_q15;
} flown_t;

typedef struct {
    const plant_run_t *run;
    const numbers_t *is;
    body_t body;
    flown_t pilot;
    double straight_mps, first_mps[2], second_mps[2];
    double waiting[DELAY_STEPS + 1][ROTORS], felt_dps[AXES], felt_g[AXES];
    double ideal_sum_rad[AXES]; /* of the controller that knows the truth */
    int32_t step;
    plant_frozen_t frozen;
} flight_t;

static inline double clip(double x, double least, double most) {
    return x < least ? least : x > most ? most : x;
}

static inline double largest(double a, double b) {
    return a > b ? a : b;
}

static inline double dot(const double a[AXES], const double b[AXES]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double now_s(const flight_t *f) {
    return f->step * f->is->period_s;
}

static inline const double *signal_of(const flight_t *f, int32_t which) {
    return f->run->signals[which];
}

/* The last row of a kind of happening that lasts at a time; NULL: there is none. */
const double *happening_at(const flight_t *f, happening_t what, double time_s);

/* Rotation matrix of a quaternion, from body to earth. */
void matrix_of(const double q[4], double m[AXES][AXES]);
/* Share of the largest thrust by a command, and the other way round. */
double share_of(const numbers_t *is, double command);
double command_for(const numbers_t *is, double share);

/* One step of the physics; felt: mean reading of an accelerometer in the centre, m/s^2, body axes. */
void body_advance(flight_t *f, const double target_radps[ROTORS], const double wind_mps[AXES],
                  double felt[AXES]);

void wind_begin(flight_t *f);
void wind_advance(flight_t *f);
void wind_now(const flight_t *f, double at_s, double found[AXES]);

/* Bias of the gyro now; raw counts of gyro and accelerometer. */
void imu_bias(const flight_t *f, double bias_dps[AXES]);
void imu_counts(const flight_t *f, int16_t *counts);

/* What the pilot asks for now; the receiver gets it with its next frame. */
void pilot_begin(flight_t *f);
void pilot_now(flight_t *f);

/* Commands of the rotors, 0 to 1, by the controller that knows the truth. */
void ideal_command(flight_t *f, double command[ROTORS]);

#endif
