/* The whole step of quad on numbers worked by hand: calibration, trust, order of the parts, pulses, flags,
 * start of a run. */
#include "check.h"
#include "core/calibration.h"
#include "core/tilt.h"
#include "systems/control.h"
#include <stdlib.h>
#include <string.h>

/* 12-bit counts around 2048: 1/256 turn/s and 1/1024 g per count, 50 Hz. */
static plumb_params_t params(void) {
    const plumb_calibration_params_t gyro = {.raw_max = 4095, .gain = 1 << 20, .offset = INT32_MIN};
    const plumb_calibration_params_t accel = {.raw_max = 4095, .gain = 1 << 16, .offset = -(1 << 27)};
    return (plumb_params_t){
        .system = PLUMB_SYSTEM_QUAD,
        .gyro = {.raw_max = 3800, .gain = gyro.gain, .raw_min = 300, .offset = gyro.offset},
        .accel = accel,
        .accel_up = accel,
        .tilt = {.mode = PLUMB_TILT_ATAN2,
                 .r_base = 1000,
                 .r_max = 1000000,
                 .deviation_max = 1 << 20,
                 .deviation_shift = 11},
        .kalman = {.dt_s_q33 = 171798692,
                   .bias_max_turn_q29 = 1 << 22,
                   .rate_gain = 1677721600,
                   .rate_shift = 6},
        .start = {.p00_hi = 1000},
        .pid = {.kp_q22 = 1 << 23, .slew_q22 = 1 << 23},
        .esc = {.mid_halfus = 3000,
                .span_halfus = 800,
                .min_halfus = 2000,
                .max_halfus = 4000,
                .neutral_halfus = 2000},
    };
}

static void calibrates(void) {
    const plumb_calibration_params_t p = {.raw_min = -100, .raw_max = 200, .gain = -3, .offset = 7};
    CHECK(plumb_calibration_valid(&p));
    CHECK(calibration_clamp(&p, -101) == -100 && calibration_clamp(&p, 201) == 200 &&
          calibration_clamp(&p, 5) == 5);
    CHECK(calibration_scale(&p, 200) == -593 && calibration_scale(&p, -100) == 307);
    plumb_calibration_params_t q = p;
    q.raw_min = 201;
    CHECK(!plumb_calibration_valid(&q));
    q = p;
    q.gain = 9395241; /* 200 * gain just beyond 7 * 2^28 */
    CHECK(!plumb_calibration_valid(&q));
    q.gain = 9395240;
    CHECK(plumb_calibration_valid(&q));
}

/* R = r_base at 1 g; r_gain 2^24 at deviation_shift 11 and |a|^2 = 1.5 g^2 (d = 2^30, d^2 = 2^28) adds 2^20.
 */
static void trusts(void) {
    plumb_tilt_params_t t = params().tilt;
    t.r_gain = 1 << 24;
    t.r_max = 1 << 24;
    CHECK(tilt_variance(&t, 0, 1 << 26) == 1000U);
    CHECK(tilt_variance(&t, 1 << 26, 0) == 1000U);
    CHECK(abs((int32_t)tilt_variance(&t, 1 << 26, 47453133) - (1000 + (1 << 20))) <= 4);
    CHECK(abs((int32_t)tilt_variance(&t, 0, 47453133) - (1000 + (1 << 20))) <= 4); /* 0.5 g^2 */
    const int32_t most = (int32_t)PLUMB_CALIBRATION_LIMIT;
    CHECK(tilt_variance(&t, -most, most - 123456789) == 1000U + (1U << 22)); /* held at deviation_max */
    t.r_max = 5000;
    CHECK(tilt_variance(&t, -most, most) == 5000U);
    CHECK(plumb_tilt_valid(&t));
    t.deviation_shift = 12;
    CHECK(!plumb_tilt_valid(&t));
    t = params().tilt;
    t.r_base = 0;
    CHECK(!plumb_tilt_valid(&t));
}

/* 1 g along y is a quarter turn; K is 1/2 (p00 = R), so the tilt is an eighth; kp 2 makes -1/4, 200 half-us
 * of 800. */
static void one_step(void) {
    const plumb_params_t p = params();
    const int16_t raw[PLUMB_RAW_MAX] = {2048, 3072, 2048, 11, -12, 13};
    control_t c;
    control_init(&c, &p);
    CHECK(control_params_valid(&p));
    control_step(&c, &p, raw, 0);
    const plumb_quad_words_t *w = &c.quad.words;
    CHECK(w->raw[1] == 3072 && w->raw[3] == 11 && w->raw[4] == -12 && w->raw[5] == 13);
    CHECK(w->rate_turnps_q28 == 0 && w->accel_y_g_q26 == 1 << 26 && w->accel_z_g_q26 == 0);
    CHECK(abs(w->tilt_measured_turn_q32 - (1 << 30)) <= 60 && w->variance == 1000U);
    CHECK(abs(w->tilt_turn_q32 - (1 << 29)) <= 60);
    CHECK(w->pid.error_turn_q32 == -w->tilt_turn_q32 && w->bias_turnps_q28 == 0);
    CHECK(abs(w->pid.command_q22 + (1 << 20)) <= 2);
    CHECK(w->pulse_halfus[0] == 2800U && w->pulse_halfus[1] == 3200U);
    CHECK(w->flags == 0U && w->step == 1U && w->clamped_steps == 0U);

    plumb_params_t fine = p;
    fine.esc.span_halfus = -3; /* 3/4 of a unit is one */
    control_init(&c, &fine);
    control_step(&c, &fine, raw, 0);
    CHECK(w->pulse_halfus[0] == 3001U && w->pulse_halfus[1] == 2999U);
}

/* U(k) is the sample before, but for the first step; on request the current one, or the mean of both. */
static void rate_of_the_step_before(void) {
    plumb_params_t p = params();
    p.tilt.r_base = p.tilt.r_max = 1 << 24; /* believe the gyro */
    p.start.p00_hi = 0;
    const int16_t still[PLUMB_RAW_MAX] = {2048, 2048, 3072};
    const int16_t turning[PLUMB_RAW_MAX] = {2048 + 256, 2048, 3072}; /* 1 turn/s: 1/50 turn per step */
    const int32_t turned[3] = {0, 85899346, 85899346 / 2};
    for (uint32_t now = 0; now < 3U; now++) {
        p.kalman.rate_now = now;
        control_t c;
        control_init(&c, &p);
        control_step(&c, &p, still, 0);
        control_step(&c, &p, turning, 0);
        CHECK(abs(c.quad.words.tilt_turn_q32 - turned[now]) <= 60);
        control_step(&c, &p, still, 0);
        CHECK(abs(c.quad.words.tilt_turn_q32 - 85899346) <= 60);
        control_init(&c, &p);
        control_step(&c, &p, turning, 0);
        CHECK(abs(c.quad.words.tilt_turn_q32 - 85899346) <= 60);
    }
}

static void limits_are_reported(void) {
    const plumb_params_t p = params();
    const int16_t raw[PLUMB_RAW_MAX] = {4095, -1, 4096};
    control_t c;
    control_init(&c, &p);
    control_step(&c, &p, raw, INT32_MIN);
    CHECK((c.quad.words.flags & 7U) ==
          (PLUMB_QUAD_FLAG_GYRO_CLAMPED | PLUMB_QUAD_FLAG_ACCEL_Y_CLAMPED | PLUMB_QUAD_FLAG_ACCEL_Z_CLAMPED));
    CHECK(c.quad.words.clamped_steps == 1U && c.quad.words.raw[0] == 4095 && c.quad.words.raw[1] == -1);
    CHECK(c.quad.words.rate_turnps_q28 == (3800 - 2048) * (1 << 20));
    control_step(&c, &p, raw, INT32_MIN);
    CHECK(c.quad.words.clamped_steps == 2U);

    plumb_params_t strong = p;
    strong.pid.kp_q22 = 1 << 30;
    control_step(&c, &strong, raw, 1 << 30);
    CHECK((c.quad.words.flags & PLUMB_QUAD_FLAG_COMMAND_LIMITED) != 0U);
    CHECK(c.quad.words.pulse_halfus[0] + c.quad.words.pulse_halfus[1] == 6000U);
    strong.esc.span_halfus = 2400;
    control_step(&c, &strong, raw, 1 << 30);
    CHECK(c.quad.words.pulse_halfus[0] == 4000U && c.quad.words.pulse_halfus[1] == 2000U);
}

/* Nothing of one run reaches the next, and the arcsine gives the angle of atan2 at 1 g. */
static void starts_afresh(void) {
    plumb_params_t p = params();
    const int16_t raw[PLUMB_RAW_MAX] = {2100, 2560, 2935}; /* 30 degrees */
    control_t a, b;
    memset(&a, 0xA5, sizeof a);
    control_init(&a, &p);
    control_step(&a, &p, raw, 0);
    control_init(&b, &p);
    control_step(&b, &p, raw, 0);
    CHECK(memcmp(&a.quad, &b.quad, sizeof a.quad) == 0);
    p.tilt.mode = PLUMB_TILT_ARCSINE;
    control_init(&b, &p);
    control_step(&b, &p, raw, 0);
    CHECK(abs(a.quad.words.tilt_measured_turn_q32 - b.quad.words.tilt_measured_turn_q32) < 200000);
    CHECK(abs(b.quad.words.tilt_measured_turn_q32 - 357913941) <= 84);
}

int main(void) {
    calibrates();
    trusts();
    one_step();
    rate_of_the_step_before();
    limits_are_reported();
    starts_afresh();
    return check_failures != 0;
}
