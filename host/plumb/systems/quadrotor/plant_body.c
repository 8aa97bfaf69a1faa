/* The body of `quadrotor` and the ground under it: plumb.physics.quadrotor and ground. */
#include "plant_flight.h"
#include <math.h>

#define LEG_COUNT 4

static void to_earth(const double matrix[AXES][AXES], const double v[AXES], double found[AXES]) {
    for (int32_t i = 0; i < AXES; i++) {
        found[i] = matrix[i][0] * v[0] + matrix[i][1] * v[1] + matrix[i][2] * v[2];
    }
}

static void to_body(const double matrix[AXES][AXES], const double v[AXES], double found[AXES]) {
    for (int32_t i = 0; i < AXES; i++) {
        found[i] = matrix[0][i] * v[0] + matrix[1][i] * v[1] + matrix[2][i] * v[2];
    }
}

static void cross(const double a[AXES], const double b[AXES], double found[AXES]) {
    found[0] = a[1] * b[2] - a[2] * b[1];
    found[1] = a[2] * b[0] - a[0] * b[2];
    found[2] = a[0] * b[1] - a[1] * b[0];
}

static double length(const double v[AXES]) {
    return sqrt(dot(v, v));
}

void matrix_of(const double q[4], double m[AXES][AXES]) {
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
    const double wx = w * x, wy = w * y, wz = w * z;
    m[0][0] = 1.0 - 2.0 * (yy + zz);
    m[0][1] = 2.0 * (xy - wz);
    m[0][2] = 2.0 * (xz + wy);
    m[1][0] = 2.0 * (xy + wz);
    m[1][1] = 1.0 - 2.0 * (xx + zz);
    m[1][2] = 2.0 * (yz - wx);
    m[2][0] = 2.0 * (xz - wy);
    m[2][1] = 2.0 * (yz + wx);
    m[2][2] = 1.0 - 2.0 * (xx + yy);
}

double share_of(const numbers_t *is, double command) {
    return (is->thrust_square * command + is->thrust_linear) * command;
}

double command_for(const numbers_t *is, double share) {
    const double square =
        is->thrust_linear * is->thrust_linear + 4.0 * is->thrust_square * clip(share, 0.0, 1.0);
    const double found = (sqrt(square) - is->thrust_linear) / (2.0 * is->thrust_square);
    return found > 1.0 ? 1.0 : found;
}

static void press(const flight_t *f, const double *leg, double height, double force[AXES],
                  double torque[AXES]) {
    const numbers_t *is = f->is;
    const body_t *b = &f->body;
    const double *normal = signal_of(f, NORMAL);
    double spun[AXES], moved[AXES], arm[AXES], pushed[AXES], along[AXES], inward[AXES], turned[AXES];
    cross(b->rate_radps, leg, spun);
    to_earth(b->matrix, spun, moved);
    for (int32_t i = 0; i < AXES; i++) {
        moved[i] = b->velocity_mps[i] + moved[i];
    }
    to_earth(b->matrix, leg, arm);
    const double depth = -(height + dot(normal, arm)), rising = dot(normal, moved);
    const double pressing = is->leg_spring_npm * depth - is->leg_damper_nspm * rising;
    const double pressed = depth > 0.0 ? largest(pressing, 0.0) : 0.0;
    for (int32_t i = 0; i < AXES; i++) {
        along[i] = moved[i] - normal[i] * rising;
    }
    const double slid = largest(length(along), is->creep_mps);
    for (int32_t i = 0; i < AXES; i++) {
        pushed[i] = normal[i] * pressed - is->friction * pressed * along[i] / slid;
    }
    to_body(b->matrix, pushed, inward);
    cross(leg, inward, turned);
    for (int32_t i = 0; i < AXES; i++) {
        force[i] += pushed[i];
        torque[i] += turned[i];
    }
}

/* Force of the ground in earth axes, N, and its torque in body axes, N m. */
static void ground_contact(const flight_t *f, double force[AXES], double torque[AXES]) {
    const double height = dot(signal_of(f, NORMAL), f->body.position_m);
    for (int32_t i = 0; i < AXES; i++) {
        force[i] = torque[i] = 0.0;
    }
    if (!(height < f->is->reach_m)) {
        return;
    }
    for (int32_t leg = 0; leg < LEG_COUNT; leg++) {
        press(f, &signal_of(f, LEGS)[AXES * leg], height, force, torque);
    }
}

static void turn(body_t *b, const numbers_t *is) {
    double half[AXES];
    for (int32_t i = 0; i < AXES; i++) {
        half[i] = b->rate_radps[i] * (is->sub_step_s / 2.0);
    }
    const double angle = length(half) + is->tiny_rad, share = sin(angle) / angle, c = cos(angle);
    const double x = half[0] * share, y = half[1] * share, z = half[2] * share;
    const double w = b->attitude[0], i = b->attitude[1], j = b->attitude[2], k = b->attitude[3];
    const double turned[4] = {
        w * c - i * x - j * y - k * z,
        w * x + i * c + j * z - k * y,
        w * y - i * z + j * c + k * x,
        w * z + i * y - j * x + k * c,
    };
    const double size =
        sqrt(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2] + turned[3] * turned[3]);
    for (int32_t n = 0; n < 4; n++) {
        b->attitude[n] = turned[n] / size;
    }
    matrix_of(b->attitude, b->matrix);
}

/* Add the mean of the vibration over the step. */
static void shake(body_t *b, const numbers_t *is, double felt[AXES]) {
    double x = 0.0, y = 0.0;
    for (int32_t rotor = 0; rotor < ROTORS; rotor++) {
        const double turned = b->rotor_radps[rotor] * is->sub_step_s, half = turned / 2.0;
        const double middle = b->phase_rad[rotor] + half;
        const double mean = half == 0.0 ? 1.0 : sin(half) / half;
        const double square = b->rotor_radps[rotor] * b->rotor_radps[rotor];
        const double size =
            b->vibration_g * is->gravity_mps2 / (is->hover_radps * is->hover_radps) * square * mean;
        b->phase_rad[rotor] = fmod(b->phase_rad[rotor] + turned, TURN_RAD);
        x += size * cos(middle);
        y += size * sin(middle);
    }
    felt[0] += x;
    felt[1] += y;
}

/* Thrust of each rotor; gives the sum of their speeds. */
static double spin(body_t *b, const numbers_t *is, const double target_radps[ROTORS],
                   double thrust_n[ROTORS]) {
    for (int32_t i = 0; i < ROTORS; i++) {
        const double away = target_radps[i] - b->rotor_radps[i];
        b->rotor_radps[i] += away * (target_radps[i] > b->rotor_radps[i] ? is->rises : is->falls);
        thrust_n[i] = is->thrust_ns2 * b->thrust_factor[i] * b->rotor_radps[i] * b->rotor_radps[i];
    }
    return b->rotor_radps[0] + b->rotor_radps[1] + b->rotor_radps[2] + b->rotor_radps[3];
}

/* Of rotors and air. */
static void push(const flight_t *f, const double thrust_n[ROTORS], double spun, const double wind_mps[AXES],
                 double force[AXES], double torque[AXES]) {
    const numbers_t *is = f->is;
    const body_t *b = &f->body;
    double past[AXES], air[AXES];
    for (int32_t i = 0; i < AXES; i++) {
        past[i] = b->velocity_mps[i] - wind_mps[i];
    }
    to_body(b->matrix, past, air);
    const double speed = length(air);
    for (int32_t i = 0; i < AXES; i++) {
        const double *arms = &signal_of(f, TORQUES)[ROTORS * i];
        force[i] = is->drag_kgpm * speed * air[i];
        torque[i] =
            arms[0] * thrust_n[0] + arms[1] * thrust_n[1] + arms[2] * thrust_n[2] + arms[3] * thrust_n[3];
    }
    torque[0] -= is->drag_above_m * force[1];
    torque[1] += is->drag_above_m * force[0];
    for (int32_t i = 0; i < 2; i++) {
        torque[i] -= is->rolling_moment_kgm * spun * air[i];
        force[i] -= is->rotor_drag_kg * spun * air[i];
    }
    force[2] += thrust_n[0] + thrust_n[1] + thrust_n[2] + thrust_n[3];
}

static void stand(flight_t *f, double force[AXES], double torque[AXES]) {
    double pushed[AXES], turned[AXES], inward[AXES];
    ground_contact(f, pushed, turned);
    to_body(f->body.matrix, pushed, inward);
    for (int32_t i = 0; i < AXES; i++) {
        force[i] += inward[i];
        torque[i] += turned[i];
    }
    f->body.pressed_n = dot(signal_of(f, NORMAL), pushed);
}

void body_advance(flight_t *f, const double target_radps[ROTORS], const double wind_mps[AXES],
                  double felt[AXES]) {
    const numbers_t *is = f->is;
    const double *inertia = signal_of(f, INERTIA);
    body_t *b = &f->body;
    double thrust_n[ROTORS], force[AXES], torque[AXES], momentum[AXES], whirled[AXES], gained[AXES];
    const double spun = spin(b, is, target_radps, thrust_n);
    push(f, thrust_n, spun, wind_mps, force, torque);
    if (is->lands != 0.0) {
        stand(f, force, torque);
    }
    for (int32_t i = 0; i < AXES; i++) {
        felt[i] = force[i] / is->mass_kg;
        momentum[i] = inertia[i] * b->rate_radps[i];
    }
    cross(b->rate_radps, momentum, whirled);
    for (int32_t i = 0; i < AXES; i++) {
        b->rate_radps[i] += is->sub_step_s / inertia[i] * (torque[i] - whirled[i]);
    }
    to_earth(b->matrix, felt, gained);
    gained[2] -= is->gravity_mps2;
    for (int32_t i = 0; i < AXES; i++) {
        b->velocity_mps[i] += is->sub_step_s * gained[i];
        b->position_m[i] += is->sub_step_s * b->velocity_mps[i];
    }
    turn(b, is);
    shake(b, is, felt);
}
