#include "plumb/phone.h"
#include "core/angle.h"
#include "core/axis.h"

#define COSINE_MIN_Q30   (1 << 26) /* 1/16: the tangent of pitch stays within +-16 */
#define STILL_TURNPS_Q28 3728270U  /* 5 deg/s */
#define SINGULAR_G_Q25   5033165U  /* 0.15 g: below it an acceleration tells no direction */
#define SINGULAR_G_Q26   10066330U
#define RATE_LIMIT_Q28   0x7fffffc0U /* 8 turn/s; a clamped rate keeps rounding noise in its last six bits */
#define QUARTER_TURN_Q32 0x40000000U
#define HALF_TURN_Q61    (INT64_C(1) << 60)

SELDOM_CALLED void plumb_phone_init(plumb_phone_t *c, const plumb_params_t *p) {
    *c = (plumb_phone_t){0};
    plumb_kalman_init(&c->words.pitch, &p->start);
    plumb_kalman_init(&c->words.roll, &p->roll.start);
}

/* The filter of roll has the period and the limits of the filter of pitch, and its own noise. */
static inline plumb_kalman_params_t roll_filter(const plumb_params_t *p) {
    plumb_kalman_params_t filter = p->kalman;
    filter.qa_hi = p->roll.qa_hi;
    filter.qa_lo = p->roll.qa_lo;
    filter.qb = p->roll.qb;
    filter.qb_frac_q30 = p->roll.qb_frac_q30;
    return filter;
}

/* Beyond 90 degrees of pitch the accelerometer measures the equivalent angles of the same attitude, and would
 * correct in the wrong direction. Switch to those angles; the rate of pitch changes its sign, and so does its
 * bias. */
static inline void change_sides(plumb_phone_words_t *w) {
    if ((uint32_t)kalman_tilt(&w->pitch) + QUARTER_TURN_Q32 > 2U * QUARTER_TURN_Q32) {
        w->pitch.tilt_turn_q61 = sub64_wrap(HALF_TURN_Q61, w->pitch.tilt_turn_q61);
        w->pitch.bias_turn_q61 = sub64_wrap(0, w->pitch.bias_turn_q61);
        w->roll.tilt_turn_q61 = add64_wrap(w->roll.tilt_turn_q61, HALF_TURN_Q61);
    }
}

/* pitch' = wy cos(roll) - wz sin(roll); roll' = wx + tan(pitch) (wy sin(roll) + wz cos(roll)); both within
 * +-8 turn/s, the cosine of pitch not below 1/16. Where roll is lost and the phone hardly turns, the second
 * term is bias and noise many times over: roll' = wx. */
static inline void euler_rates(plumb_phone_words_t *w, int32_t x, int32_t y, int32_t z, bool roll_lost) {
    int32_t sin_pitch, cos_pitch, sin_roll, cos_roll;
    plumb_angle_sincos(kalman_tilt(&w->pitch), &sin_pitch, &cos_pitch);
    plumb_angle_sincos(kalman_tilt(&w->roll), &sin_roll, &cos_roll);

    const uint32_t cosine = (uint32_t)max_i32(cos_pitch, COSINE_MIN_Q30);
    const unsigned n = clz32(cosine);
    const uint32_t secant_q26 = reciprocal_q61(cosine << (n - 1U)) >> (6U - n);
    const bool still =
        abs_u32(x) < STILL_TURNPS_Q28 && abs_u32(y) < STILL_TURNPS_Q28 && abs_u32(z) < STILL_TURNPS_Q28;
    const int32_t tangent_q26 =
        roll_lost && still ? 0 : sat_shl_hi(mul_i64(sin_pitch, (int32_t)secant_q26), 2);
    const int32_t across = sat_shl_hi(add64_wrap(mul_i64(y, sin_roll), mul_i64(z, cos_roll)), 2);
    w->tangent_q26 = tangent_q26;
    w->pitch_rate_turnps_q28 = sat_shl_hi(sub64_wrap(mul_i64(y, cos_roll), mul_i64(z, sin_roll)), 2);
    w->roll_rate_turnps_q28 = sat_shl_hi(add64_wrap(mul_i64(tangent_q26, across), mul_i64(x, 1 << 26)), 6);
}

/* One axis. A lost measurement is replaced by the value that the filter expects, with variance r_max: it
 * corrects nothing, and the covariance is still propagated. */
KERNEL axis_estimate_t estimate(plumb_kalman_t *k, const plumb_kalman_params_t *p,
                                axis_measurement_t measured, bool lost, int32_t rate) {
    if (lost) {
        measured.tilt_turn_q32 = kalman_predicted(k, p, rate);
    }
    return axis_filter(k, p, measured, rate, rate);
}

/* Not inlined, because both angles call it. */
__attribute__((noinline)) static int32_t direction(int32_t y, int32_t x) {
    return angle_atan2(y, x);
}

void plumb_phone_step(plumb_phone_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX],
                      int32_t setpoint_turn_q32) {
    plumb_phone_words_t *w = &c->words;
    axis_record_raw(w->raw, raw);
    w->setpoint_turn_q32 = setpoint_turn_q32;

    uint32_t flags = 0;
    const int32_t rate_x = calibration_apply(&p->gyro, raw[0], &flags, PLUMB_PHONE_FLAG_GYRO_CLAMPED);
    const int32_t rate_y = calibration_apply(&p->gyro, raw[1], &flags, PLUMB_PHONE_FLAG_GYRO_CLAMPED);
    const int32_t rate_z = calibration_apply(&p->gyro, raw[2], &flags, PLUMB_PHONE_FLAG_GYRO_CLAMPED);
    const int32_t accel_x = calibration_apply(&p->accel, raw[3], &flags, PLUMB_PHONE_FLAG_ACCEL_CLAMPED);
    const int32_t accel_y = calibration_apply(&p->accel, raw[4], &flags, PLUMB_PHONE_FLAG_ACCEL_CLAMPED);
    const int32_t accel_z = calibration_apply(&p->accel, raw[5], &flags, PLUMB_PHONE_FLAG_ACCEL_CLAMPED);
    w->accel_x_g_q26 = accel_x;
    w->accel_y_g_q26 = accel_y;
    w->accel_z_g_q26 = accel_z;

    /* asin(x / |a|) is the direction of (length of y and z, x), which is as fine beside the vertical */
    const uint32_t lateral_q25 = plumb_angle_length(accel_y, accel_z);
    w->pitch_measured_turn_q32 = direction(-asr32(accel_x, 1), (int32_t)lateral_q25);
    w->roll_measured_turn_q32 = direction(accel_y, accel_z);
    const bool roll_lost = lateral_q25 < SINGULAR_G_Q25;
    const bool pitch_lost = roll_lost && abs_u32(accel_x) < SINGULAR_G_Q26;
    w->uncorrected_steps += roll_lost;
    flags |= (roll_lost ? PLUMB_PHONE_FLAG_ROLL_UNCORRECTED : 0U) |
             (pitch_lost ? PLUMB_PHONE_FLAG_PITCH_UNCORRECTED : 0U);

    const uint32_t step = w->step + 1U;
    const int32_t x = axis_driving_rate(&p->kalman, step == 1U, rate_x, w->rate_x_turnps_q28);
    const int32_t y = axis_driving_rate(&p->kalman, step == 1U, rate_y, w->rate_y_turnps_q28);
    const int32_t z = axis_driving_rate(&p->kalman, step == 1U, rate_z, w->rate_z_turnps_q28);
    w->step = step;
    w->rate_x_turnps_q28 = rate_x;
    w->rate_y_turnps_q28 = rate_y;
    w->rate_z_turnps_q28 = rate_z;
    if (p->phone.rates == PLUMB_PHONE_EULER_RATES) {
        if (!roll_lost) {
            change_sides(w);
        }
        euler_rates(w, x, y, z, roll_lost);
    } else {
        w->pitch_rate_turnps_q28 = y;
        w->roll_rate_turnps_q28 = x;
    }
    if (abs_u32(w->pitch_rate_turnps_q28) >= RATE_LIMIT_Q28 ||
        abs_u32(w->roll_rate_turnps_q28) >= RATE_LIMIT_Q28) {
        flags |= PLUMB_PHONE_FLAG_GYRO_CLAMPED;
    }
    w->clamped_steps += (flags & PLUMB_PHONE_FLAGS_SATURATED) != 0U;
    w->flags = flags;

    w->pitch_variance = pitch_lost ? p->tilt.r_max : p->tilt.r_base;
    w->roll_variance = roll_lost ? p->roll.r_max : p->roll.r_base;
    const plumb_kalman_params_t roll_kalman = roll_filter(p);
    const axis_measurement_t pitch_measured = {w->pitch_measured_turn_q32, w->pitch_variance};
    const axis_measurement_t roll_measured = {w->roll_measured_turn_q32, w->roll_variance};
    const axis_estimate_t pitch =
        estimate(&w->pitch, &p->kalman, pitch_measured, pitch_lost, w->pitch_rate_turnps_q28);
    w->pitch_turn_q32 = pitch.tilt_turn_q32;
    w->pitch_bias_turnps_q28 = pitch.bias_turnps_q28;
    w->pitch_rate_corrected_turnps_q28 = pitch.rate_corrected_turnps_q28;
    const axis_estimate_t roll =
        estimate(&w->roll, &roll_kalman, roll_measured, roll_lost, w->roll_rate_turnps_q28);
    w->roll_turn_q32 = roll.tilt_turn_q32;
    w->roll_bias_turnps_q28 = roll.bias_turnps_q28;
    w->roll_rate_corrected_turnps_q28 = roll.rate_corrected_turnps_q28;
}

SELDOM_CALLED bool plumb_phone_params_valid(const plumb_params_t *p) {
    const plumb_kalman_params_t roll_kalman = roll_filter(p);
    return plumb_calibration_valid(&p->gyro) && plumb_calibration_valid(&p->accel) &&
           plumb_tilt_valid(&p->tilt) && plumb_kalman_valid(&p->kalman, &p->start) &&
           p->phone.rates <= PLUMB_PHONE_EULER_RATES && p->roll.r_base >= 1U &&
           p->roll.r_base <= p->roll.r_max && p->roll.r_max <= PLUMB_KALMAN_R_MAX &&
           plumb_kalman_valid(&roll_kalman, &p->roll.start);
}
