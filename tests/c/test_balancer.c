/* The balancer's step on numbers worked by hand: Hall edges, the axle's acceleration, the cascade, the fall.
 */
#include "check.h"
#include "core/wheel.h"
#include "systems/control.h"
#include <stdlib.h>
#include <string.h>

/* 1/256 turn/s and 1/1024 g per count, 100 Hz; K is 1/2 in the first step (p00 = R). One edge is 1/4 m/s, the
 * filter of the speed takes a quarter of every change. */
static plumb_params_t params(void) {
    const plumb_calibration_params_t gyro = {.raw_min = -1000, .raw_max = 1000, .gain = 1 << 20};
    const plumb_calibration_params_t accel = {.raw_min = -4095, .raw_max = 4094, .gain = 1 << 16};
    return (plumb_params_t){
        .system = PLUMB_SYSTEM_BALANCER,
        .gyro = gyro,
        .accel = {.raw_min = -4095, .raw_max = 4094, .gain = -(1 << 16)},
        .accel_up = accel,
        .tilt = {.mode = PLUMB_TILT_ATAN2, .r_base = 1000, .r_max = 1000000},
        .kalman = {.dt_s_q33 = 85899346,
                   .bias_max_turn_q29 = 1 << 21,
                   .rate_gain = 1677721600,
                   .rate_shift = 7},
        .start = {.p00_hi = 1000},
        .wheel = {.edges_max = 60, .edge_mps_q26 = 1 << 24, .alpha_q31 = 1 << 29, .accel_gain_q30 = 1 << 29},
        .speed = {.kp_q22 = 1 << 28, .slew_q22 = 1 << 23},
        .pid = {.kp_q22 = 1 << 25, .slew_q22 = 1 << 23},
        .drive = {.speed_max_mps_q26 = 1 << 26,
                  .lean_max_turn_q34 = 1 << 28,
                  .span_q15 = -16384,
                  .duty_max_q15 = 8000,
                  .fall_turn_q32 = 1U << 29},
    };
}

static const plumb_balancer_words_t *step(control_t *c, const plumb_params_t *p, int x, int z, int hall,
                                          int32_t setpoint_mps_q26) {
    const int16_t raw[PLUMB_RAW_MAX] = {0, (int16_t)x, (int16_t)z, (int16_t)hall, 0, 0};
    control_step(c, p, raw, setpoint_mps_q26);
    return &c->balancer.words;
}

/* Edges are differences of a count that wraps; the first step has none; a quarter of the change is filtered,
 * half a g per m/s of it is the acceleration. */
static void wheels(void) {
    const plumb_params_t p = params();
    control_t c;
    control_init(&c, &p);
    CHECK(control_params_valid(&p));
    const plumb_balancer_words_t *w = step(&c, &p, 0, 1024, 32767, 0);
    CHECK(w->wheel.speed_mps_q26 == 0 && w->wheel.velocity_mps_q26 == 0 && w->wheel.accel_g_q26 == 0);
    w = step(&c, &p, 0, 1024, -32767, 0); /* two edges on */
    CHECK(w->wheel.speed_mps_q26 == 1 << 25 && w->wheel.velocity_mps_q26 == 1 << 23);
    CHECK(w->wheel.accel_g_q26 == 1 << 24 && w->gravity_x_g_q26 == 1 << 24);
    w = step(&c, &p, 0, 1024, -32767, 0); /* standing: the speed falls back by a quarter */
    CHECK(w->wheel.speed_mps_q26 == 0 && w->wheel.velocity_mps_q26 == (1 << 23) - (1 << 21));
    CHECK(w->wheel.accel_g_q26 == -(1 << 22) && (w->flags & PLUMB_BALANCER_FLAGS_SATURATED) == 0U);
    w = step(&c, &p, 0, 1024, -32767 - 61, 0);
    CHECK(w->wheel.speed_mps_q26 == -(60 << 24) && (w->flags & PLUMB_BALANCER_FLAG_WHEEL_CLAMPED) != 0U);
    CHECK(w->wheel.accel_g_q26 == -WHEEL_ACCEL_LIMIT && w->clamped_steps == 1U);
}

/* A vehicle that accelerates by 1/4 g feels it on the forward axis: taken off, it stands upright. */
static void leaning_and_accelerating_cancel(void) {
    const plumb_params_t p = params();
    control_t c;
    control_init(&c, &p);
    (void)step(&c, &p, 0, 1024, 0, 0);
    const plumb_balancer_words_t *w = step(&c, &p, 256, 1024, 2, 0);
    CHECK(w->accel_x_g_q26 == -(1 << 24) && w->gravity_x_g_q26 == 0 && w->tilt_measured_turn_q32 == 0);
    plumb_params_t q = p;
    q.wheel.accel_gain_q30 = 0; /* as the source has it */
    control_init(&c, &q);
    (void)step(&c, &q, 0, 1024, 0, 0);
    w = step(&c, &q, 256, 1024, 2, 0);
    CHECK(w->gravity_x_g_q26 == -(1 << 24) && w->tilt_measured_turn_q32 < -(1 << 27));
}

/* 1/4 m/s asked for: command 1/4 of a lean of 1/64 turn, 1/256; kp 8: command 1/32, half of it is the duty.
 */
static void the_cascade(void) {
    const plumb_params_t p = params();
    control_t c;
    control_init(&c, &p);
    const plumb_balancer_words_t *w = step(&c, &p, 0, 1024, 0, 1 << 24);
    CHECK(w->setpoint_mps_q26 == 1 << 24 && w->speed.error_turn_q32 == 1 << 24);
    CHECK(w->speed.command_q22 == 1 << 20 && w->lean_turn_q32 == 1 << 24);
    CHECK(w->pid.error_turn_q32 == 1 << 24 && w->pid.command_q22 == 1 << 17);
    CHECK(w->duty_q15 == -512 && w->flags == 0U && w->step == 1U);
    w = step(&c, &p, 0, 1024, 0, -(1 << 28)); /* four times what may be asked for */
    CHECK((w->flags & PLUMB_BALANCER_FLAG_SETPOINT_CLAMPED) != 0U && w->speed.error_turn_q32 == -(1 << 26));
    CHECK(w->speed.command_q22 == -(1 << 22) && w->lean_turn_q32 == -(1 << 26) && w->duty_q15 == 2048);
    CHECK((w->flags & PLUMB_BALANCER_FLAG_LEAN_LIMITED) == 0U);
    plumb_params_t q = p;
    q.speed.kp_q22 = 1 << 29;
    q.pid.kp_q22 = 1 << 30;
    control_init(&c, &q);
    w = step(&c, &q, 0, 1024, 0, -(1 << 26));
    CHECK((w->flags & PLUMB_BALANCER_FLAG_LEAN_LIMITED) != 0U &&
          (w->flags & PLUMB_BALANCER_FLAG_COMMAND_LIMITED) != 0U);
    CHECK(w->duty_q15 == 8000); /* duty_max, not span */
}

/* A sixteenth of a turn is beyond the fall: from then on the duty is 0, upright or not. */
static void fallen(void) {
    plumb_params_t p = params();
    p.drive.fall_turn_q32 = (1U << 28) - (1U << 20);
    control_t c;
    control_init(&c, &p);
    const plumb_balancer_words_t *w =
        step(&c, &p, -1024, 1024, 0, 0); /* an eighth measured, a sixteenth believed */
    CHECK(abs(w->tilt_turn_q32 - (1 << 28)) < 1 << 19 && (w->flags & PLUMB_BALANCER_FLAG_FALLEN) != 0U &&
          w->duty_q15 == 0);
    for (int i = 0; i < 200; i++) {
        w = step(&c, &p, 0, 1024, 0, 1 << 26);
    }
    CHECK(abs(w->tilt_turn_q32) < 1 << 26 && w->pid.command_q22 != 0);
    CHECK((w->flags & PLUMB_BALANCER_FLAG_FALLEN) != 0U && w->duty_q15 == 0);
    p.drive.fall_turn_q32 = 1U << 31;
    control_init(&c, &p);
    w = step(&c, &p, 0, -1024, 0, 0);
    CHECK((w->flags & PLUMB_BALANCER_FLAG_FALLEN) == 0U);
}

/* One beyond every limit is refused. */
static void refuses(void) {
    const plumb_params_t good = params();
    plumb_params_t p;
#define REFUSED(change) (p = good, (change), !control_params_valid(&p))
    CHECK(REFUSED(p.wheel.edges_max = 0) && REFUSED(p.wheel.edges_max = 61));
    CHECK(REFUSED(p.wheel.edge_mps_q26 = (1 << 24) + 1) && REFUSED(p.wheel.edge_mps_q26 = INT32_MIN));
    CHECK(REFUSED(p.wheel.alpha_q31 = -1) && REFUSED(p.wheel.accel_gain_q30 = -1));
    CHECK(REFUSED(p.drive.speed_max_mps_q26 = (8 << 26) + 1) && REFUSED(p.drive.speed_max_mps_q26 = -1));
    CHECK(REFUSED(p.drive.lean_max_turn_q34 = (1 << 30) + 1) && REFUSED(p.drive.lean_max_turn_q34 = -1));
    CHECK(REFUSED(p.drive.span_q15 = -32768) && REFUSED(p.drive.duty_max_q15 = -1));
    CHECK(REFUSED(p.drive.duty_max_q15 = 32768) && REFUSED(p.drive.fall_turn_q32 = (1U << 31) + 1U));
    CHECK(REFUSED(p.speed.slew_q22 = 0) && REFUSED(p.pid.slew_q22 = 0) && REFUSED(p.tilt.r_base = 0));
    CHECK(REFUSED(p.system = 99));
}

/* Wild inputs at the widest parameters: the bounds of the headers hold (and sanitizers see no overflow). */
static void stays_within(void) {
    plumb_params_t p = params();
    p.wheel.edges_max = 32767;
    p.wheel.edge_mps_q26 = (int32_t)(WHEEL_SPEED_LIMIT / 32767);
    p.wheel.alpha_q31 = INT32_MAX;
    p.wheel.accel_gain_q30 = INT32_MAX;
    p.speed = (plumb_pid_params_t){
        .kp_q22 = 1 << 30, .ki_dt_q22 = INT32_MAX, .kd_q27 = -(1 << 30), .slew_q22 = 1 << 23};
    p.pid = p.speed;
    p.drive = (plumb_drive_params_t){.speed_max_mps_q26 = 8 << 26,
                                     .lean_max_turn_q34 = 1 << 30,
                                     .span_q15 = 32767,
                                     .duty_max_q15 = 32767,
                                     .fall_turn_q32 = 1U << 31};
    CHECK(control_params_valid(&p));
    control_t c;
    control_init(&c, &p);
    for (int i = 0; i < 200000; i++) {
        int16_t raw[PLUMB_RAW_MAX];
        for (unsigned k = 0; k < PLUMB_RAW_MAX; k++) {
            raw[k] = (int16_t)check_random_wild();
        }
        control_step(&c, &p, raw, check_random_wild());
        const plumb_balancer_words_t *w = &c.balancer.words;
        CHECK(labs((long)w->wheel.speed_mps_q26) <= WHEEL_SPEED_LIMIT);
        CHECK(labs((long)w->wheel.velocity_mps_q26) <= WHEEL_SPEED_LIMIT + 2);
        CHECK(labs((long)w->wheel.accel_g_q26) <= WHEEL_ACCEL_LIMIT);
        CHECK(labs((long)w->lean_turn_q32) <= 1L << 28 && abs(w->duty_q15) <= 32767);
    }
}

int main(void) {
    wheels();
    leaning_and_accelerating_cancel();
    the_cascade();
    fallen();
    refuses();
    stays_within();
    return check_failures != 0;
}
