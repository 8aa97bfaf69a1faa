/* The plant of `quad` for batches of runs: the equations, and their order, of plant.py and drawn_run.py. */
#include "ports/batch/plant.h"
#include <math.h>
#include <stdbool.h>

#define DEG_TO_RAD (3.14159265358979323846 / 180.0)
#define RAD_TO_DEG (180.0 / 3.14159265358979323846)
#define CHANNELS   3
#define MOTORS     2

typedef struct {
    double open_loop, grid_s, delay_points;
    double motor_keep, thrust_moment_nm, friction_nms, inertia_kgm2, imbalance_nm, gust_keep, gust_new_nm,
        stop_deg;
    double pulse_zero_us, pulse_span_us;
    double decay, pole_new, pole_old;
    double scale, offset_y_g, offset_z_g;
    double gyro_zero_v, gyro_v_per_dps, gyro_range_dps, accel_zero_v, accel_v_per_g, accel_range_g;
    double adc_per_v, adc_most, reference_v, fault_noise_v;
} numbers_t;

enum {
    PRESCRIBED_DEG = 0,
    LATERAL_G,
    HAND,
    GUSTS,
    PUSHED_NM,
    BIAS_DPS,
    GYRO_NOISE_DPS,
    ACCEL_NOISE_G,
    ADC_NOISE_V,
    FAULT_NOISE
};

typedef struct {
    const plant_run_t *run;
    const numbers_t *is;
    double tilt_deg, rate_dps, speed[MOTORS], gust_nm;
    double force_g[2], filtered_g[2];
    double frozen_v[PLANT_FAULTS_MAX];
    bool frozen[PLANT_FAULTS_MAX];
    bool driven;
    int32_t step;
    double waiting[501][MOTORS]; /* throttles on their way to the motors, a ring of delay_points */
} axis_t;

static void specific_force(const axis_t *a, double force_g[2]) {
    const double tilt_rad = a->tilt_deg * DEG_TO_RAD;
    force_g[0] = sin(tilt_rad) + a->run->signals[LATERAL_G][a->step % (a->run->points - 1)];
    force_g[1] = cos(tilt_rad);
}

static double clip(double x, double least, double most) {
    return x < least ? least : x > most ? most : x;
}

static void begin(void *plant, const plant_run_t *run) {
    axis_t *a = plant;
    *a = (axis_t){.run = run, .is = (const numbers_t *)(const void *)run->numbers};
    a->tilt_deg = run->signals[PRESCRIBED_DEG][0];
    specific_force(a, a->force_g);
    a->filtered_g[0] = a->force_g[0];
    a->filtered_g[1] = a->force_g[1];
}

/* The throttles that reach the motors now, after the delay. */
static void arrive(axis_t *a, const double throttle[MOTORS], double arrived[MOTORS]) {
    const int32_t points = (int32_t)a->is->delay_points;
    for (int32_t i = 0; i < MOTORS; i++) {
        arrived[i] = throttle[i];
        if (points) {
            arrived[i] = a->waiting[a->step % points][i];
            a->waiting[a->step % points][i] = throttle[i];
        }
        if (arrived[i] != 0.0) {
            a->driven = true;
        }
    }
}

static void prescribe(axis_t *a) {
    const double *tilt_deg = a->run->signals[PRESCRIBED_DEG];
    const int32_t n = a->step, last = a->run->points - 1;
    a->tilt_deg = tilt_deg[n < last ? n : last];
    a->rate_dps = (tilt_deg[n + 1 < last ? n + 1 : last] - tilt_deg[n - 1 < last ? n - 1 : last]) /
                  (2.0 * a->is->grid_s);
}

static void turn(axis_t *a) {
    const numbers_t *is = a->is;
    const int32_t n = a->step, last = a->run->points - 1;
    a->gust_nm = is->gust_keep * a->gust_nm + is->gust_new_nm * a->run->signals[GUSTS][n % last];
    const double turning_nm = is->thrust_moment_nm * (pow(a->speed[0], 2.0) - pow(a->speed[1], 2.0));
    const double friction_nm = is->friction_nms * (a->rate_dps * DEG_TO_RAD);
    const double pushed_nm = a->run->signals[PUSHED_NM][n - 1 < last ? n - 1 : last];
    const double torque_nm = turning_nm - friction_nm + is->imbalance_nm + a->gust_nm + pushed_nm;
    a->rate_dps += torque_nm / is->inertia_kgm2 * RAD_TO_DEG * is->grid_s;
    a->tilt_deg += a->rate_dps * is->grid_s;
    if (fabs(a->tilt_deg) > is->stop_deg) {
        a->tilt_deg = copysign(is->stop_deg, a->tilt_deg);
        a->rate_dps = 0.0;
    }
}

static void advance(axis_t *a) {
    const numbers_t *is = a->is;
    const int32_t last = a->run->points - 1;
    a->step++;
    if (is->open_loop != 0.0 || a->run->signals[HAND][a->step < last ? a->step : last] != 0.0 || !a->driven) {
        prescribe(a);
    } else {
        turn(a);
    }
    double force_g[2];
    specific_force(a, force_g);
    for (int32_t i = 0; i < 2; i++) {
        a->filtered_g[i] =
            is->decay * a->filtered_g[i] + is->pole_new * force_g[i] + is->pole_old * a->force_g[i];
        a->force_g[i] = force_g[i];
    }
}

static void follow(void *plant, double time_s, const int32_t *outputs) {
    axis_t *a = plant;
    double throttle[MOTORS] = {0.0, 0.0};
    for (int32_t i = 0; outputs && i < MOTORS; i++) {
        throttle[i] = clip((outputs[i] / 2.0 - a->is->pulse_zero_us) / a->is->pulse_span_us, 0.0, 1.0);
    }
    const int32_t until = (int32_t)floor(time_s / a->is->grid_s + 1e-6);
    while (a->step < until) {
        double arrived[MOTORS];
        arrive(a, throttle, arrived);
        for (int32_t i = 0; i < MOTORS; i++) {
            a->speed[i] = arrived[i] + (a->speed[i] - arrived[i]) * a->is->motor_keep;
        }
        advance(a);
    }
}

static void fail(axis_t *a, int32_t k, double time_s, double volts[CHANNELS]) {
    for (int32_t i = 0; i < a->run->fault_count; i++) {
        const plant_fault_t *fault = &a->run->faults[i];
        const int32_t channel = (int32_t)fault->channel;
        if (time_s < fault->start_s) {
            continue;
        }
        if (!a->frozen[i]) {
            a->frozen[i] = true;
            a->frozen_v[i] = volts[channel];
        }
        if (time_s >= fault->stop_s) {
            continue;
        }
        switch ((plant_fault_kind_t)fault->kind) {
        case PLANT_FAULT_RAILED:
            volts[channel] = a->is->reference_v;
            break;
        case PLANT_FAULT_STUCK:
            volts[channel] = a->frozen_v[i];
            break;
        case PLANT_FAULT_NOISY:
            volts[channel] +=
                a->is->fault_noise_v * a->run->signals[FAULT_NOISE][channel * a->run->steps + k];
            break;
        case PLANT_FAULT_SILENT:
            volts[channel] = 0.0;
            break;
        case PLANT_FAULT_FLICKERING:
        case PLANT_FAULT_AMPLIFIED:
        case PLANT_FAULT_MISSING:
            break; /* an analog sensor has none of these */
        }
    }
}

static void sample(void *plant, int32_t k, double time_s, int16_t *counts, double *truth) {
    axis_t *a = plant;
    const numbers_t *is = a->is;
    const double *const *of = a->run->signals;
    const int32_t steps = a->run->steps;
    const double offset_g[2] = {is->offset_y_g, is->offset_z_g};
    const double rate_dps = is->scale * a->rate_dps + of[BIAS_DPS][k] + of[GYRO_NOISE_DPS][k];
    double volts[CHANNELS];
    volts[0] = is->gyro_zero_v + is->gyro_v_per_dps * clip(rate_dps, -is->gyro_range_dps, is->gyro_range_dps);
    for (int32_t i = 0; i < 2; i++) {
        const double force_g = a->filtered_g[i] + of[ACCEL_NOISE_G][i * steps + k] + offset_g[i];
        volts[1 + i] =
            is->accel_zero_v + is->accel_v_per_g * clip(force_g, -is->accel_range_g, is->accel_range_g);
    }
    for (int32_t i = 0; i < CHANNELS; i++) {
        volts[i] += of[ADC_NOISE_V][i * steps + k];
    }
    fail(a, k, time_s, volts);
    for (int32_t i = 0; i < CHANNELS; i++) {
        counts[i] = (int16_t)clip(rint(volts[i] * is->adc_per_v), 0.0, is->adc_most);
    }
    truth[0] = a->tilt_deg;
    truth[1] = of[BIAS_DPS][k];
}

extern const plant_t plumb_plant_quad;
__attribute__((visibility("default"))) const plant_t plumb_plant_quad = {
    .numbers =
        "open_loop,grid_s,delay_points,motor_keep,thrust_moment_nm,friction_nms,inertia_kgm2,imbalance_nm,"
        "gust_keep,gust_new_nm,stop_deg,pulse_zero_us,pulse_span_us,decay,pole_new,pole_old,scale,offset_y_g,"
        "offset_z_g,gyro_zero_v,gyro_v_per_dps,gyro_range_dps,accel_zero_v,accel_v_per_g,accel_range_g,"
        "adc_per_v,adc_most,reference_v,fault_noise_v",
    .signals =
        "prescribed_deg,lateral_g,hand,gusts,pushed_nm,bias_dps,gyro_noise_dps,accel_noise_g,adc_noise_v,"
        "fault_noise",
    .truth = "tilt_deg,bias_dps",
    .bytes = sizeof(axis_t),
    .truths = 2,
    .begin = begin,
    .follow = follow,
    .sample = sample,
};
