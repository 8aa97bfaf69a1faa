/* The balancer's step on parameters and counts from all over their ranges: under the sanitizers no sum of it
 * may overflow, and whatever comes, what has a limit keeps it (docs/reference/arithmetic/balancer.md, "Why
 * the sums fit"). */
#include "core/wheel.h"
#include "wild.h"

#define SETS  400U
#define STEPS 300U

/* A set that the firmware accepts; in half of them as many edges as the speed has room for. */
static plumb_params_t wild(void) {
    params_t all;
    do {
        wild_control(&all, PLUMB_SYSTEM_BALANCER);
        const int32_t edge = all.control.wheel.edge_mps_q26;
        if (check_random() % 2U == 0U && edge > (1 << 15)) {
            all.control.wheel.edges_max = (int32_t)(WHEEL_SPEED_LIMIT / edge);
        }
    } while (!control_params_valid(&all.control));
    return all.control;
}

static bool within(int64_t value, int64_t most) {
    return value >= -most && value <= most;
}

static void check_pid(const plumb_pid_t *pid) {
    CHECK(pid->command_q22 >= -(1 << 22) && pid->command_q22 < 1 << 22);
    CHECK(within(pid->integral_q54, (int64_t)1 << 55));
}

static void check_words(const plumb_balancer_words_t *w, const plumb_params_t *p) {
    const plumb_drive_params_t *drive = &p->drive;
    CHECK(within(w->wheel.speed_mps_q26, WHEEL_SPEED_LIMIT));
    CHECK(within(w->wheel.velocity_mps_q26, WHEEL_SPEED_LIMIT + 1));
    CHECK(within(w->wheel.accel_g_q26, WHEEL_ACCEL_LIMIT));
    CHECK(within(w->gravity_x_g_q26, (int64_t)31 << 26));
    CHECK(w->gravity_x_g_q26 == w->accel_x_g_q26 + w->wheel.accel_g_q26);
    CHECK(within(w->speed.error_turn_q32, drive->speed_max_mps_q26 + WHEEL_SPEED_LIMIT + 1));
    CHECK(within(w->lean_turn_q32, drive->lean_max_turn_q34 / 4 + 1));
    CHECK(within(w->duty_q15, drive->duty_max_q15));
    CHECK((w->flags & PLUMB_BALANCER_FLAG_FALLEN) == 0U || w->duty_q15 == 0);
    CHECK(w->variance >= p->tilt.r_base && w->variance <= p->tilt.r_max);
    CHECK(w->kalman.p00 >= 0 && w->kalman.p00 <= (int64_t)1 << 57 && w->kalman.p11 >= 0 &&
          w->kalman.p11 < (int64_t)1 << 56);
    CHECK(w->kalman.k0_q29 >= 0 && within(w->kalman.k1_q29, 1 << 29));
    check_pid(&w->speed);
    check_pid(&w->pid);
}

/* Counts that jump, rest, are small, or stand at an end; wheels that stand, roll or are all over the place.
 */
static void run_wild(uint32_t set) {
    const plumb_params_t p = wild();
    control_t c;
    control_init(&c, &p);
    int16_t raw[PLUMB_RAW_MAX] = {0};
    uint32_t clamped = 0, fallen = 0;
    for (unsigned step = 0; step < STEPS; step++) {
        wild_counts(raw, set, INT16_MIN);
        control_step(&c, &p, raw, check_random_wild());
        check_words(&c.balancer.words, &p);
        clamped += (c.balancer.words.flags & PLUMB_BALANCER_FLAGS_SATURATED) != 0U;
        CHECK(fallen == 0U || (c.balancer.words.flags & PLUMB_BALANCER_FLAG_FALLEN) != 0U);
        fallen = c.balancer.words.flags & PLUMB_BALANCER_FLAG_FALLEN;
    }
    CHECK(c.balancer.words.step == STEPS && c.balancer.words.clamped_steps == clamped);
}

int main(void) {
    for (uint32_t set = 0; set < SETS; set++) {
        run_wild(set);
    }
    return check_failures == 0 ? 0 : 1;
}
