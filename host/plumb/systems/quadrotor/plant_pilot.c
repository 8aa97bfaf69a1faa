/* Pilot and receiver of `quadrotor`: plumb.physics.pilots and vehicle.py. */
#include "plant_flight.h"
#include <math.h>

#define ROTORS_ON 1
#define MODE_RATE 2

static void lean(const numbers_t *is, double time_s, double asked[AXES]) {
    const double share = time_s < is->lean_until_s ? 1.0 : 0.0;
    asked[0] = share * is->lean_roll_rad;
    asked[1] = share * is->lean_pitch_rad;
    asked[2] = share * is->lean_yaw_radps;
}

static void hold_place(const flight_t *f, const double *seen_m, const double *seen_mps, double asked[AXES]) {
    const numbers_t *is = f->is;
    const double x = f->body.matrix[0][0], y = f->body.matrix[1][0];
    const double size = largest(sqrt(x * x + y * y), 1e-6), cosine = x / size, sine = y / size;
    double accel[2];
    for (int32_t i = 0; i < 2; i++) {
        const double away_m = seen_m[i] - signal_of(f, BEGIN_M)[i];
        accel[i] = -(is->place_per_s2 * away_m + is->speed_per_s * seen_mps[i] +
                     is->place_sum_per_s3 * f->pilot.sum_ms[i]);
    }
    const double forward = accel[0] * cosine + accel[1] * sine, left = accel[1] * cosine - accel[0] * sine;
    asked[0] = clip(atan(-left / is->gravity_mps2), -is->lean_max_rad, is->lean_max_rad);
    asked[1] = clip(atan(forward / is->gravity_mps2), -is->lean_max_rad, is->lean_max_rad);
}

/* Roll and pitch in rad, yaw rate in rad/s. */
static void steer(const flight_t *f, const double *seen_m, const double *seen_mps, double asked[AXES]) {
    const numbers_t *is = f->is;
    const double time_s = now_s(f) - is->acts_s;
    asked[0] = asked[1] = asked[2] = 0.0;
    if (time_s < 0.0) {
        return;
    }
    switch ((pilot_t)is->pilot) {
    case LEANING:
        lean(is, time_s, asked);
        break;
    case PLACE:
        hold_place(f, seen_m, seen_mps, asked);
        break;
    case STICKS: {
        const double *drawn = &signal_of(f, STICKS_DRAWN)[2 * (int32_t)(time_s / is->sticks_every_s)];
        asked[0] = is->sticks_rad * drawn[0];
        asked[1] = is->sticks_rad * drawn[1];
        break;
    }
    case SHUTTLE:
        asked[1] = ((int32_t)(time_s / is->shuttle_s) % 2 == 0 ? 1.0 : -1.0) * is->shuttle_rad;
        break;
    }
}

/* Height to hold, and its rate. */
static double wanted_height(const flight_t *f, double *climb_mps) {
    const numbers_t *is = f->is;
    const double begin_m = signal_of(f, BEGIN_M)[2], at_s = now_s(f),
                 risen_m = (at_s - is->rest_s) * is->climb_mps;
    *climb_mps = 0.0;
    if (is->lands == 0.0) {
        return begin_m;
    }
    if (at_s < is->land_at_s) {
        *climb_mps = risen_m < is->climb_m ? is->climb_mps : 0.0;
        return begin_m + (risen_m < is->climb_m ? risen_m : is->climb_m);
    }
    *climb_mps = -is->sink_mps;
    return begin_m + is->climb_m - is->sink_mps * (at_s - is->land_at_s);
}

static void hold_height(flight_t *f) {
    const numbers_t *is = f->is;
    const body_t *b = &f->body;
    double climb_mps;
    const double low = wanted_height(f, &climb_mps) - b->position_m[2], slow = climb_mps - b->velocity_mps[2];
    double *sum_ms = &f->pilot.height_sum_ms;
    *sum_ms = clip(*sum_ms + low * is->period_s, -is->height_sum_most_ms, is->height_sum_most_ms);
    const double accel = is->height_per_s2 * low + is->climb_per_s * slow + is->height_sum_per_s3 * *sum_ms;
    const double wanted =
        is->mass_kg * (is->gravity_mps2 + clip(accel, -5.0, 8.0)) / largest(b->matrix[2][2], 0.5);
    f->pilot.thrust_n = clip(wanted, 0.0, is->thrust_most_n);
}

static int16_t word(const numbers_t *is, double share) {
    return (int16_t)rint(clip(share, -1.0, 1.0) * is->full);
}

static void receive(flight_t *f, int32_t number, bool flying) {
    const numbers_t *is = f->is;
    flown_t *p = &f->pilot;
    const double at_s = now_s(f), roll = p->lean_rad[0], pitch = p->lean_rad[1];
    double sticks[AXES] = {sin(roll) * cos(pitch) / is->stick_lean, sin(pitch) / is->stick_lean,
                           p->yaw_radps * DEG_PER_RAD / is->stick_yaw_dps};
    int32_t switches = flying && p->landed_s + is->keeps_on_s > at_s ? ROTORS_ON : 0;
    if (p->turn) {
        sticks[0] = p->turn[2] / is->stick_rate_dps;
        sticks[1] = p->turn[3] / is->stick_rate_dps;
        sticks[2] = p->turn[4] / is->stick_yaw_dps;
        switches |= MODE_RATE;
    }
    for (int32_t i = 0; i < AXES; i++) {
        p->commands[i] = word(is, sticks[i]);
    }
    p->commands[3] = (int16_t)switches;
    p->commands[4] = (int16_t)number;
    const double *given = happening_at(f, THROTTLE, at_s);
    double share = flying ? command_for(is, p->thrust_n / (is->thrust_max_n * is->supply)) : 0.0;
    share = given ? given[3] : share;
    const bool low = p->landed_s <= at_s || happening_at(f, CUT, at_s);
    p->throttle_q15 = low ? 0 : (int32_t)rint(share * is->full);
}

void pilot_begin(flight_t *f) {
    f->pilot.received_s = -1.0;
    f->pilot.landed_s = HUGE_VAL;
}

/* Note place and speed; gives the place in the ring of what the pilot sees now. */
static int32_t see(flight_t *f) {
    flown_t *p = &f->pilot;
    const int32_t most = (int32_t)f->is->seen_steps, newest = p->seen % most;
    for (int32_t i = 0; i < AXES; i++) {
        p->seen_m[newest][i] = f->body.position_m[i];
        p->seen_mps[newest][i] = f->body.velocity_mps[i];
    }
    p->seen++;
    return p->seen < most ? 0 : p->seen % most;
}

void pilot_now(flight_t *f) {
    const numbers_t *is = f->is;
    flown_t *p = &f->pilot;
    const double at_s = now_s(f), above_m = dot(signal_of(f, NORMAL), f->body.position_m);
    const bool flying = at_s >= is->rest_s;
    const int32_t seen = see(f);
    double asked[AXES];
    for (int32_t i = 0; flying && i < 2; i++) {
        const double away_m = p->seen_m[seen][i] - signal_of(f, BEGIN_M)[i];
        p->sum_ms[i] =
            clip(p->sum_ms[i] + is->period_s * away_m, -is->place_sum_most_ms, is->place_sum_most_ms);
    }
    steer(f, p->seen_m[seen], p->seen_mps[seen], asked);
    p->lean_rad[0] = asked[0];
    p->lean_rad[1] = asked[1];
    p->yaw_radps = asked[2];
    if (flying && is->held == 0.0) {
        hold_height(f);
    }
    p->turn = NULL;
    for (int32_t i = 0; i < (int32_t)is->turns && !p->turn; i++) {
        const double *row = &signal_of(f, TURNS)[TURN_ROW * i];
        p->turn = row[0] <= at_s && at_s < row[1] ? row : NULL;
    }
    const bool touched = is->lands != 0.0 && above_m < is->leg_down_m + is->touched_m;
    if (touched && at_s > is->land_at_s && at_s < p->landed_s) {
        p->landed_s = at_s;
    }
    const int32_t frame = (int32_t)(at_s / is->frame_s + 1e-6);
    if (frame * is->frame_s > p->received_s && !happening_at(f, DEAF, at_s)) {
        p->received_s = frame * is->frame_s;
        receive(f, frame % (int32_t)is->frame_numbers + 1, flying);
    }
}
