#include "plumb/wheels.h"
#include "core/axis.h"
#include "core/calibration.h"
#include "core/fixed.h"
#include "core/rate_loop.h"
#include "generated/ranges.h"
#include "systems/wheels_doubt.h"
#include <string.h>

#define STEPS_MOST   65535U
#define CLOSED_TAKES 4U         /* open steps that a closed step of the rider's switch outweighs */
#define TURN_MOST    (4L << 28) /* turn/s Q28: what the wheels may show, and what is asked for at most */
#define BIAS_MOST    (1L << 27) /* turn/s Q28: with a calibrated rate of 7 within what the loop takes */

/* Inputs: channels, then commands. */
enum { GYRO, ACCEL_X, ACCEL_Z, GYRO_UP, LEFT, RIGHT, RIDER, ROLL = 9, PITCH, YAW, SWITCHES, RECEIVER };

#define INPUTS (sizeof((plumb_wheels_words_t *)0)->raw / sizeof(int32_t))

/* The words from the calibrated gyro to the duty are those of balancer, in its order. */
#define FIRST offsetof(plumb_wheels_words_t, rate_turnps_q28)
#define TAKEN (offsetof(plumb_balancer_words_t, flags) - offsetof(plumb_balancer_words_t, rate_turnps_q28))

typedef char wheels_assert_same_words[offsetof(plumb_wheels_words_t, duty_q15) - FIRST ==
                                              offsetof(plumb_balancer_words_t, duty_q15) -
                                                  offsetof(plumb_balancer_words_t, rate_turnps_q28)
                                          ? 1
                                          : -1];

/* Four words at a time, in registers: a third of the cycles of one call that copies all. */
KERNEL void take_balancer(plumb_wheels_words_t *w, const plumb_balancer_words_t *b) {
    char *const to = (char *)w + FIRST;
    const char *const from = (const char *)b + offsetof(plumb_balancer_words_t, rate_turnps_q28);
    for (size_t at = 0; at < TAKEN / 16U * 16U; at += 16U) {
        memcpy(to + at, from + at, 16U);
    }
    memcpy(to + TAKEN / 16U * 16U, from + TAKEN / 16U * 16U, TAKEN % 16U);
}

SELDOM_CALLED void plumb_wheels_init(plumb_wheels_t *c, const plumb_params_t *p) {
    *c = (plumb_wheels_t){0};
    plumb_balancer_init(&c->balancer, p);
    take_balancer(&c->words, &c->balancer.words);
    c->words.absent_steps = p->wheels.absent_steps;
}

/* Share of the most that a stick, Q15, asks for, in the format of the most. */
KERNEL int32_t by_stick(int32_t stick, int32_t most) {
    return 2 * mulhi_i32(clamp_i32(stick, -INT16_MAX, INT16_MAX) * 65536, most);
}

/* True while the receiver is lost. */
KERNEL bool listen(plumb_wheels_words_t *w, uint32_t lost_steps, int32_t receiver) {
    const uint32_t number = (uint32_t)receiver & PLUMB_WHEELS_NUMBER_MASK;
    w->age_steps = number != 0U && number == w->receiver_number ? min_u32(w->age_steps + 1U, STEPS_MOST) : 0U;
    w->receiver_number = number;
    return number != 0U && ((receiver & PLUMB_WHEELS_FAILSAFE) != 0 || w->age_steps >= lost_steps);
}

/* Whether somebody rides, and what happens when the rider has left. A rider is there once the count of open
 * steps is down to 0, and gone when it is full, as it is at the start: a closed step takes CLOSED_TAKES off,
 * so that a switch that is closed for less than a fifth of the time is no rider. Without an accelerometer
 * nobody rides on. Switched off, the controllers are at rest, so that no integral grows while a hand holds
 * the vehicle. */
KERNEL void decide(plumb_wheels_words_t *w, const plumb_wheels_params_t *q, bool present, bool blind,
                   bool on) {
    const uint32_t before = w->phase;
    const uint32_t absent = w->absent_steps;
    w->absent_steps = !present                ? min_u32(absent + 1U, q->absent_steps)
                      : absent > CLOSED_TAKES ? absent - CLOSED_TAKES
                                              : 0U;
    const bool rides = present && w->absent_steps == 0U && !blind;
    w->phase_steps = min_u32(w->phase_steps + 1U, STEPS_MOST);
    if (!on) {
        w->phase = PLUMB_WHEELS_STOPPED;
    } else if (before == PLUMB_WHEELS_STOPPED) {
        if (rides && abs_u32(w->tilt_turn_q32) <= q->up_turn_q32) {
            w->phase = PLUMB_WHEELS_RIDDEN;
        }
    } else if (before == PLUMB_WHEELS_RIDDEN) {
        if (w->absent_steps >= q->absent_steps || blind) {
            w->phase = PLUMB_WHEELS_STOPPING;
        }
    } else if (rides) {
        w->phase = PLUMB_WHEELS_RIDDEN;
    } else if (w->phase_steps > q->stopping_steps) {
        w->phase = PLUMB_WHEELS_STOPPED;
    }
    if (w->phase != before) {
        w->phase_steps = 0U;
    }
}

/* Turn rate: that of the gyro, its bias taken off, which follows the difference of the wheels slowly. Where
 * both disagree by more than an encoder's counts can, a wheel slips. */
KERNEL uint32_t turning(plumb_wheels_words_t *w, const plumb_params_t *p, int32_t difference, int32_t count) {
    const plumb_wheels_params_t *const q = &p->wheels;
    uint32_t flags = 0;
    const int32_t gyro = calibration_apply(&p->gyro, count, &flags, PLUMB_WHEELS_FLAG_GYRO_UP_CLAMPED);
    const int32_t used = clamp_i32(difference, -q->counts_max, q->counts_max);
    const int32_t rolled = used * q->count_turnps_q28;
    const int32_t apart = asr32(gyro, 1) - asr32(rolled, 1) - asr32(w->turn_bias_turnps_q28, 1);
    const int32_t doubt = asr32(q->doubt_turnps_q28, 1);
    w->turn_gyro_turnps_q28 = gyro;
    w->turn_wheels_turnps_q28 = rolled;
    if (abs_u32(apart) > (uint32_t)asr32(q->slip_turnps_q28, 1)) {
        w->slip_steps = q->slip_hold;
    } else if (w->slip_steps != 0U) {
        w->slip_steps--;
    }
    if (w->slip_steps == 0U) {
        w->turn_bias_turnps_q28 = clamp_i32(
            w->turn_bias_turnps_q28 + 4 * mulhi_i32(clamp_i32(apart, -doubt, doubt), q->bias_alpha_q31),
            -BIAS_MOST, BIAS_MOST);
    }
    w->turn_rate_turnps_q28 = gyro - w->turn_bias_turnps_q28;
    return flags | (used != difference ? PLUMB_WHEELS_FLAG_WHEEL_CLAMPED : 0U);
}

/* Balance first, turning gets what it leaves. While a wheel slips, the other one has to balance alone: it
 * gets twice the duty, and turning nothing. */
KERNEL uint32_t mix(plumb_wheels_words_t *w, int32_t duty_max_q15, int32_t turn_max_q15) {
    const int32_t wanted = asr32(w->turn.demand_q24, 9);
    int32_t duty = w->duty_q15, turn = 0;
    if (w->slip_steps != 0U) {
        duty = clamp_i32(2 * duty, -duty_max_q15, duty_max_q15);
    } else {
        const int32_t room = min_i32(duty_max_q15 - (int32_t)abs_u32(duty), turn_max_q15);
        turn = clamp_i32(wanted, -room, room);
    }
    w->turn.excess_q24 = (wanted - turn) * 512;
    w->turn_duty_q15 = turn;
    w->duty_left_q15 = duty - turn;
    w->duty_right_q15 = duty + turn;
    return wanted != turn ? PLUMB_WHEELS_FLAG_TURN_LIMITED : 0U;
}

void plumb_wheels_step(plumb_wheels_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                       int32_t setpoint_speed_q15) {
    plumb_wheels_words_t *const w = &c->words;
    const plumb_wheels_params_t *const q = &p->wheels;
    const bool first = w->step == 0U;
    const int32_t left = first ? 0 : (int16_t)sub_wrap(raw[LEFT], w->raw[LEFT]);
    const int32_t right = first ? 0 : (int16_t)sub_wrap(raw[RIGHT], w->raw[RIGHT]);
    const bool odd = plumb_wheels_is_odd(w);
    const bool repeats = !first && (raw[ACCEL_X] == w->raw[ACCEL_X] || raw[ACCEL_Z] == w->raw[ACCEL_Z]);
    w->still_steps = in_a_row(w->still_steps, odd || repeats, q->still_steps);
    const bool blind = w->still_steps >= q->still_steps;
    axis_record_raw(w->raw, raw);
    axis_record_raw(w->raw + 6, raw + 6);
    for (unsigned i = 12; i < INPUTS; i++) {
        w->raw[i] = raw[i];
    }
    w->setpoint_speed_q15 = setpoint_speed_q15;
    w->step++;

    const bool lost = listen(w, q->lost_steps, raw[RECEIVER]);
    const bool on = w->receiver_number == 0U || ((uint32_t)raw[SWITCHES] & PLUMB_WHEELS_MOTORS_ON) != 0U;
    decide(w, q, raw[RIDER] > 0, blind, on);
    const bool obeys = w->phase == PLUMB_WHEELS_RIDDEN && !lost;
    const int32_t speed = w->receiver_number != 0U ? raw[PITCH] : setpoint_speed_q15;
    w->asked_mps_q26 = obeys ? by_stick(speed, p->drive.speed_max_mps_q26) : 0;
    w->asked_turnps_q28 = obeys ? by_stick(raw[YAW] - raw[ROLL], q->turn_max_turnps_q28) : 0;

    plumb_balancer_words_t *const b = &c->balancer.words;
    if (w->phase == PLUMB_WHEELS_STOPPED) {
        plumb_pid_init(&b->speed);
        plumb_pid_init(&b->pid);
    }
    uint32_t flags = turning(w, p, right - left, raw[GYRO_UP]);
    const bool slips = w->slip_steps != 0U;
    w->sum_counts = plumb_wheels_both(w, p, left, right);
    const int16_t one_wheel[PLUMB_RAW_MAX] = {raw[GYRO], raw[ACCEL_X], raw[ACCEL_Z],
                                              (int16_t)(b->raw[3] + w->sum_counts)};
    c->balancer.blind = blind || odd;
    const int32_t has = b->wheel.velocity_mps_q26;
    const int32_t wanted =
        slips ? clamp_i32(w->asked_mps_q26, has - q->slip_mps_q26, has + q->slip_mps_q26) : w->asked_mps_q26;
    plumb_balancer_step(&c->balancer, p, one_wheel, wanted);
    take_balancer(w, b);

    flags |= b->flags | plumb_wheels_doubt(w, q, on, left, right, p->drive.duty_max_q15);
    w->stop_reason = plumb_wheels_stopped_by(w, flags, on, blind);
    const bool drives = on && w->stop_reason == 0U;
    rate_loop_step(&w->turn, &p->turn, INT32_MAX, q->integral_max_q30, w->asked_turnps_q28,
                   w->turn_rate_turnps_q28,
                   !drives ? RATE_LOOP_OFF
                   : slips ? RATE_LOOP_GROUNDED
                           : RATE_LOOP_FLYING);
    if (drives) {
        flags |= mix(w, p->drive.duty_max_q15, q->turn_duty_max_q15) | PLUMB_WHEELS_FLAG_DRIVES;
    } else {
        w->turn.excess_q24 = 0;
        w->turn_duty_q15 = 0;
        w->duty_left_q15 = 0;
        w->duty_right_q15 = 0;
    }
    w->flags = flags | (lost ? PLUMB_WHEELS_FLAG_LOST : 0U) | (slips ? PLUMB_WHEELS_FLAG_SLIPS : 0U) |
               (blind ? PLUMB_WHEELS_FLAG_ACCEL_STILL : 0U);
}

SELDOM_CALLED void plumb_wheels_retune(plumb_wheels_t *c, const plumb_params_t *from,
                                       const plumb_params_t *to) {
    plumb_balancer_retune(&c->balancer, from, to);
}

SELDOM_CALLED bool plumb_wheels_params_valid(const plumb_params_t *p) {
    const plumb_wheels_params_t *const q = &p->wheels;
    return plumb_balancer_params_valid(p) && plumb_rate_loop_valid(&p->turn) && wheels_in_range(q) &&
           (uint64_t)abs_u32(q->count_turnps_q28) * (uint32_t)q->counts_max <= TURN_MOST;
}

/* As balancer; a rider who steps on shakes it. */
const plumb_plausibility_bounds_t plumb_wheels_plausibility = {
    PLUMB_PLAUSIBILITY_PLACES(plumb_wheels_words_t, asked_mps_q26, accel_x_g_q26, accel_z_g_q26),
    .stopped = PLUMB_PLAUSIBILITY_AT(plumb_wheels_words_t, stop_reason),
    .setpoint_max = 3355443U,      /* 0.05 m/s: no stick rests in its very middle */
    .accel_min_g2_q20 = 167772U,   /* 0.4 g */
    .accel_max_g2_q20 = 3397386U,  /* 1.8 g */
    .rest_min_g2_q20 = 849347U,    /* 0.9 g */
    .rest_max_g2_q20 = 1268777U,   /* 1.1 g */
    .rest_turnps_q28 = 7456540U,   /* 10 deg/s */
    .uneven_turn_q32 = 357913941U, /* 30 deg a step, as balancer */
    .ready_turn_q32 = 119304647U,  /* 10 deg */
    .doubts = true,                /* blind, or odd */
};
