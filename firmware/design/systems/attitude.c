/* Doubles in the order of host/plumb/systems/attitude/quantise.py, so that both round alike.
 *
 * The filter's unit of a bias is 1/4 rad/s, of a scale error 1/64, of a tilt 1 rad and of a velocity 2 g s.
 */
#include "plumb/attitude.h"
#include "design/groups.h"

#define PI           3.141592653589793
#define DEG          (PI / 180.0)
#define G_MPS2       9.80665
#define BIAS_UNITS   (4.0 * DEG)            /* of the filter in 1 deg/s */
#define SCALE_UNITS  64.0                   /* in a scale error of 1 */
#define SPEED_UNITS  (1.0 / (2.0 * G_MPS2)) /* in 1 m/s */
#define VARIANCE_MAX ((int64_t)858993459)   /* 0.2, Q32: before the first sample */
#define TOLERANCE    1e-3                   /* of an integer, relative */
#define LONGEST_US   318000                 /* a block is shorter */
#define BOUND        0x1p400                /* no integer sees a larger setting */

/* What the groups are converted with: the period and the time of a block in s, and its steps. */
typedef struct {
    double dt_s, s;
    int32_t steps;
} block_t;

/* The setting whose square, by units and weight, is this integer, Q32. */
static double setting(double word, double units, double weight) {
    return plumb_design_root(word / (0x1p32 * weight)) / units;
}

/* Refuse what has no square in its integer. The tolerance takes the largest integer's own setting. */
static bool within(plumb_design_t *d, const char *field, double sigma, double most) {
    plumb_design_not_negative(d, field, sigma);
    if (sigma > most * (1.0 + TOLERANCE / 4.0)) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_LARGE, field, sigma, 0.0, most);
    }
    return d->error == PLUMB_DESIGN_OK;
}

/* weight (sigma units)^2, Q32, within low to high. */
static int64_t weighted(plumb_design_t *d, const char *field, double sigma, double units, int64_t low,
                        int64_t high, double weight) {
    const double most = setting((double)high, units, weight);
    if (!within(d, field, sigma, most)) {
        return low;
    }
    const double x = sigma * units, value = weight * (x * x) * 0x1p32;
    int64_t nearest = wide_round(wide_of(value));
    nearest = nearest < low ? low : nearest > high ? high : nearest;
    const double apart = (double)nearest - value;
    if (sigma == 0.0 && low > 0) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, field, sigma, 0.0, DESIGN_NO_LIMIT);
    } else if (value < (double)low && low > 1) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_SMALL, field, sigma, setting((double)low, units, weight),
                            most);
    } else if ((apart < 0.0 ? -apart : apart) > value * TOLERANCE) {
        plumb_design_refuse(d, PLUMB_DESIGN_TOO_FINE, field, sigma, setting(500.0, units, weight), most);
    }
    return nearest;
}

/* A variance before the first sample. */
static int32_t square(plumb_design_t *d, const char *field, double sigma, double units) {
    return (int32_t)weighted(d, field, sigma, units, 1, VARIANCE_MAX, 1.0);
}

/* The growth of a variance in `seconds`, Q32, as near as its integer comes: 0 below half of one. */
static int32_t growth(plumb_design_t *d, const char *field, double sigma, double units, double seconds,
                      int32_t high) {
    if (!within(d, field, sigma, plumb_design_root((double)high / 0x1p32 / seconds) / units)) {
        return 0;
    }
    const double x = sigma * units;
    const int64_t nearest = wide_round(wide_of(x * x * seconds * 0x1p32));
    return (int32_t)(nearest < high ? nearest : high);
}

static int32_t word(plumb_design_t *d, const char *field, double asked, double value, int32_t high) {
    plumb_design_not_negative(d, field, asked);
    return (int32_t)plumb_design_whole(d, field, asked, wide_of(value), 0, high);
}

/* A time, in blocks of which it has at least so many, as a share of a block, Q32. */
static int32_t pass(plumb_design_t *d, const char *field, double seconds, double least, const block_t *b) {
    if (seconds < least * b->s) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, seconds, least * b->s, DESIGN_NO_LIMIT);
        return 0;
    }
    return (int32_t)wide_round(wide_of(b->s / seconds * 0x1p32));
}

static void mounting(plumb_design_t *d, const char *field, const plumb_mounting_tuning_t *t,
                     plumb_mounting_params_t *w) {
    const double entries[9] = {t->xx, t->xy, t->xz, t->yx, t->yy, t->yz, t->zx, t->zy, t->zz};
    int32_t *const words[9] = {&w->xx_q30, &w->xy_q30, &w->xz_q30, &w->yx_q30, &w->yy_q30,
                               &w->yz_q30, &w->zx_q30, &w->zy_q30, &w->zz_q30};
    for (int i = 0; i < 9; i++) {
        const int64_t nearest = wide_round(wide_of(entries[i] * 0x1p30));
        if (nearest > DESIGN_WORD_MAX || nearest < -DESIGN_WORD_MAX) {
            plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field, entries[i], -2.0, 2.0);
            return;
        }
        *words[i] = (int32_t)nearest;
    }
    if (!plumb_mounting_valid(w)) {
        const double of_xx = t->yy * t->zz - t->yz * t->zy, of_xy = t->yx * t->zz - t->yz * t->zx,
                     of_xz = t->yx * t->zy - t->yy * t->zx;
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, field,
                            t->xx * of_xx - t->xy * of_xy + t->xz * of_xz, 0.5, 2.0);
    }
}

/* False for the identity. */
static bool turned(const plumb_mounting_params_t *w) {
    const int32_t one = (int32_t)PLUMB_MOUNTING_ONE;
    const bool diagonal = w->xx_q30 == one && w->yy_q30 == one && w->zz_q30 == one;
    return !diagonal || w->xy_q30 != 0 || w->xz_q30 != 0 || w->yx_q30 != 0 || w->yz_q30 != 0 ||
           w->zx_q30 != 0 || w->zy_q30 != 0;
}

static void gyro_words(plumb_design_t *d, const plumb_attitude_gyro_tuning_t *t, const block_t *b,
                       plumb_attitude_params_t *w) {
    w->start_bias = square(d, "errors.bias_dps", t->bias_dps, BIAS_UNITS);
    w->start_scale = square(d, "errors.scale", t->scale, SCALE_UNITS);
    w->q_bias = growth(d, "errors.bias_walk_dps", t->bias_walk_dps, BIAS_UNITS, b->s, 1 << 24);
    w->q_scale = growth(d, "errors.scale_walk", t->scale_walk, SCALE_UNITS, b->s, 1 << 20);
    w->q_tilt = growth(d, "errors.noise_dps", t->noise_dps, DEG, b->s, 1 << 26);
    w->q_turn_q24 = (int32_t)weighted(d, "errors.turn_noise", t->turn_noise, 1.0, 0, 1 << 30, 4.0 / b->dt_s);
    w->q_clipped = growth(d, "errors.clipped_deg", t->clipped_deg, DEG, 1.0, 1 << 27);
}

/* A velocity is one error for as long as it lasts, not a new one every block: so much larger is its variance.
 */
static void travel_words(plumb_design_t *d, const plumb_attitude_tuning_t *t, const block_t *b,
                         plumb_attitude_params_t *w) {
    const plumb_attitude_motion_tuning_t *m = &t->motion;
    const double gain = 2.0 * (m->travel_s < BOUND ? m->travel_s : BOUND) / b->s;
    w->travel_pass_q32 = pass(d, "motion.travel_s", m->travel_s, 4.0, b);
    w->travel_least_q24 =
        (int32_t)weighted(d, "motion.travel_mps", m->travel_mps, 1.0 / G_MPS2, 0, 1 << 29, 0x1p-8);
    w->travel_gain_q16 = word(d, "motion.travel_s", m->travel_s, gain * 0x1p16, 1 << 26);
    w->doubt_q24 = (int32_t)weighted(d, "errors.turn_doubt", t->errors.turn_doubt, G_MPS2, 0, 1 << 30,
                                     4.0 / b->dt_s * 0x1p-8);
}

static void motion_words(plumb_design_t *d, const plumb_attitude_motion_tuning_t *t, const block_t *b,
                         plumb_attitude_params_t *w) {
    w->velocity_pass_q32 = pass(d, "motion.pass_s", t->pass_s, 3.0, b);
    w->leak_q32 = pass(d, "motion.leak_s", t->leak_s, 4.0, b);
    w->start_tilt = square(d, "motion.start_tilt_deg", t->start_tilt_deg, DEG);
    w->start_speed = square(d, "motion.start_velocity_mps", t->start_velocity_mps, SPEED_UNITS);
    w->speed_min = (int32_t)weighted(d, "motion.velocity_mps", t->velocity_mps, 1.0 / G_MPS2, 1 << 8,
                                     VARIANCE_MAX, 1.0 / 64.0);
    w->velocity_share_q16 =
        word(d, "motion.share", t->share, (t->share < BOUND ? t->share : BOUND) * 0x1p16, 1 << 20);
    w->unsure =
        (uint32_t)weighted(d, "motion.unsure_deg", t->unsure_deg, DEG, 0, ((int64_t)1 << 32) - 1, 2.0);
}

static void rest_words(plumb_design_t *d, const plumb_attitude_rest_tuning_t *t, const block_t *b,
                       plumb_attitude_params_t *w) {
    const double gyro_dps = t->gyro_dps < BOUND ? t->gyro_dps : BOUND;
    const double turn_dps = t->turn_dps < BOUND ? t->turn_dps : BOUND;
    const double accel_g = t->accel_g < BOUND ? t->accel_g : BOUND, blocks = t->seconds / b->s;
    w->rest_gyro =
        word(d, "rest.gyro_dps", t->gyro_dps, gyro_dps * DEG * b->dt_s / 2.0 * 0x1p32, DESIGN_WORD_MAX);
    w->rest_turn =
        word(d, "rest.turn_dps", t->turn_dps, turn_dps * DEG * b->s / 2.0 * 0x1p32, DESIGN_WORD_MAX);
    w->rest_accel = word(d, "rest.accel_g", t->accel_g, accel_g * (double)b->steps * 0x1p18, DESIGN_WORD_MAX);
    if (t->seconds <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "rest.seconds", t->seconds, 0.0, DESIGN_NO_LIMIT);
    } else if (blocks >= 255.5) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "rest.seconds", t->seconds, 0.0, 255.0 * b->s);
    } else {
        w->rest_blocks = blocks < 1.0 ? 1 : (int32_t)wide_round(wide_of(blocks));
    }
    w->rest_variance =
        (int32_t)weighted(d, "rest.noise_dps", t->noise_dps, BIAS_UNITS, 1 << 8, VARIANCE_MAX, 1.0);
}

static void aid_words(plumb_design_t *d, const plumb_attitude_aid_tuning_t *t, plumb_attitude_params_t *w) {
    const double drag = t->drag_per_s;
    plumb_design_not_negative(d, "aid.drag_per_s", drag);
    if (drag != 0.0 && (drag < 1.0 / 64.0 || drag > 16.0)) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "aid.drag_per_s", drag, 1.0 / 64.0, 16.0);
    }
    if (d->error != PLUMB_DESIGN_OK) {
        return;
    }
    w->aid_s_q24 = word(d, "aid.drag_per_s", drag, drag != 0.0 ? 0x1p24 / drag : 0.0, 1 << 30);
    w->aid_variance = (int32_t)weighted(d, "aid.velocity_mps", t->velocity_mps, 1.0 / G_MPS2, 1 << 8,
                                        VARIANCE_MAX, 1.0 / 64.0);
    w->aid_hover_q15 = word(d, "aid.hover", t->hover, (t->hover < BOUND ? t->hover : BOUND) * 0x1p15, 27853);
}

/* The block whose time is nearest to block_s, of at least 15 steps. */
static block_t block_of(plumb_design_t *d, double block_s, int32_t period_us, plumb_attitude_params_t *w) {
    const wide_t us = wide_of((double)period_us);
    const int64_t asked = wide_round(wide_div(wide_product(block_s < BOUND ? block_s : BOUND, 1e6), us));
    const int64_t steps = asked < 15 ? 15 : asked, longest = (LONGEST_US - 1) / period_us;
    const int64_t most = longest < 125 ? longest : 125;
    if (block_s <= 0.0) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "block_s", block_s, 0.0, DESIGN_NO_LIMIT);
    } else if (steps > most) {
        plumb_design_refuse(d, PLUMB_DESIGN_OUT_OF_RANGE, "block_s", block_s, 0.0,
                            (double)(most * period_us) / 1e6);
    }
    const int64_t used = steps < most ? steps : most;
    const block_t block = {(double)period_us / 1e6, (double)(used * period_us) / 1e6, (int32_t)used};
    w->dt_s_q33 = (uint32_t)wide_round(wide_div(wide_mul(us, wide_of(0x1p33)), wide_of(1e6)));
    w->half_angle = (int32_t)wide_round(wide_div(wide_mul(us, wide_of(PI * 0x1p34)), wide_of(1e6)));
    w->block_steps = block.steps;
    w->inverse_block_q32 = (int32_t)wide_round(wide_div(wide_of(0x1p32), wide_of((double)used)));
    w->rest_gain_q20 = (int32_t)wide_round(wide_div(wide_of(0x1p19 * 1e6), us));
    return block;
}

#define MOUNTING_FINITE(d, t, member)                                                                        \
    do {                                                                                                     \
        DESIGN_FINITE(d, t, member.xx);                                                                      \
        DESIGN_FINITE(d, t, member.xy);                                                                      \
        DESIGN_FINITE(d, t, member.xz);                                                                      \
        DESIGN_FINITE(d, t, member.yx);                                                                      \
        DESIGN_FINITE(d, t, member.yy);                                                                      \
        DESIGN_FINITE(d, t, member.yz);                                                                      \
        DESIGN_FINITE(d, t, member.zx);                                                                      \
        DESIGN_FINITE(d, t, member.zy);                                                                      \
        DESIGN_FINITE(d, t, member.zz);                                                                      \
    } while (0)

static void all_finite(plumb_design_t *d, const plumb_attitude_tuning_t *t) {
    DESIGN_FINITE(d, t, gyro.zero_counts);
    DESIGN_FINITE(d, t, gyro.unit_per_count);
    DESIGN_FINITE(d, t, accel.zero_counts);
    DESIGN_FINITE(d, t, accel.unit_per_count);
    MOUNTING_FINITE(d, t, gyro_mounting);
    MOUNTING_FINITE(d, t, accel_mounting);
    DESIGN_FINITE(d, t, errors.bias_dps);
    DESIGN_FINITE(d, t, errors.scale);
    DESIGN_FINITE(d, t, errors.bias_walk_dps);
    DESIGN_FINITE(d, t, errors.noise_dps);
    DESIGN_FINITE(d, t, errors.turn_noise);
    DESIGN_FINITE(d, t, errors.scale_walk);
    DESIGN_FINITE(d, t, errors.clipped_deg);
    DESIGN_FINITE(d, t, errors.turn_doubt);
    DESIGN_FINITE(d, t, motion.velocity_mps);
    DESIGN_FINITE(d, t, motion.share);
    DESIGN_FINITE(d, t, motion.pass_s);
    DESIGN_FINITE(d, t, motion.leak_s);
    DESIGN_FINITE(d, t, motion.start_tilt_deg);
    DESIGN_FINITE(d, t, motion.start_velocity_mps);
    DESIGN_FINITE(d, t, motion.unsure_deg);
    DESIGN_FINITE(d, t, motion.travel_mps);
    DESIGN_FINITE(d, t, motion.travel_s);
    DESIGN_FINITE(d, t, rest.gyro_dps);
    DESIGN_FINITE(d, t, rest.accel_g);
    DESIGN_FINITE(d, t, rest.turn_dps);
    DESIGN_FINITE(d, t, rest.seconds);
    DESIGN_FINITE(d, t, rest.noise_dps);
    DESIGN_FINITE(d, t, aid.drag_per_s);
    DESIGN_FINITE(d, t, aid.velocity_mps);
    DESIGN_FINITE(d, t, aid.hover);
    DESIGN_FINITE(d, t, block_s);
}

plumb_design_t plumb_attitude_design(const plumb_attitude_tuning_t *tuning, plumb_params_t *params) {
    static const design_channel_names_t gyro = DESIGN_CHANNEL_NAMES("gyro"),
                                        accel = DESIGN_CHANNEL_NAMES("accel");
    const plumb_attitude_tuning_t *t = tuning;
    plumb_design_t d = PLUMB_DESIGN_NONE_REFUSED;
    all_finite(&d, t);
    plumb_design_period(&d, t->period_us);
    if (t->period_us < 1000 || t->period_us > 21000) {
        plumb_design_refuse(&d, PLUMB_DESIGN_OUT_OF_RANGE, "period_us", (double)t->period_us, 1e3, 21e3);
    }
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    plumb_params_t made = {.system = PLUMB_SYSTEM_ATTITUDE};
    plumb_attitude_params_t *const w = &made.attitude;
    const block_t block = block_of(&d, t->block_s, t->period_us, w);
    mounting(&d, "gyro_mounting", &t->gyro_mounting, &made.gyro_mounting);
    mounting(&d, "accel_mounting", &t->accel_mounting, &made.accel_mounting);
    w->mounted = turned(&made.gyro_mounting) || turned(&made.accel_mounting) ? 1U : 0U;
    plumb_design_channel(&d, &gyro, &t->gyro, plumb_design_turn_unit(), &made.gyro);
    plumb_design_channel(&d, &accel, &t->accel, plumb_design_g_unit(), &made.accel);
    if (d.error != PLUMB_DESIGN_OK) {
        return d;
    }
    gyro_words(&d, &t->errors, &block, w);
    travel_words(&d, t, &block, w);
    motion_words(&d, &t->motion, &block, w);
    rest_words(&d, &t->rest, &block, w);
    aid_words(&d, &t->aid, w);
    if (d.error == PLUMB_DESIGN_OK) {
        *params = made;
    }
    return d;
}
