/* Wind and sensors of `quadrotor`: plumb.physics.wind and imu. */
#include "plant_flight.h"
#include <math.h>

#define NOISES     9
#define OF_SENSORS 6
#define ROOT_3     1.7320508075688772

static const double *noise_now(const flight_t *f) {
    return &signal_of(f, NOISE)[NOISES * (f->step % f->run->steps)];
}

void wind_begin(flight_t *f) {
    const double *kept = signal_of(f, GUSTS_KEPT);
    f->straight_mps = kept[0];
    for (int32_t i = 0; i < 2; i++) {
        f->first_mps[i] = kept[1 + i];
        f->second_mps[i] = kept[3 + i];
    }
}

void wind_advance(flight_t *f) {
    const double *share = signal_of(f, GUSTS_SHARE), *fresh = signal_of(f, GUSTS_NEW);
    const double *white = &noise_now(f)[OF_SENSORS];
    f->straight_mps += share[0] * -f->straight_mps + fresh[0] * white[0];
    for (int32_t i = 0; i < 2; i++) {
        f->second_mps[i] += share[1 + i] * (f->first_mps[i] - f->second_mps[i]);
        f->first_mps[i] += share[1 + i] * -f->first_mps[i] + fresh[1 + i] * white[1 + i];
    }
}

void wind_now(const flight_t *f, double at_s, double found[AXES]) {
    const numbers_t *is = f->is;
    const double along = is->wind_mps + f->straight_mps;
    double other[2];
    for (int32_t i = 0; i < 2; i++) {
        other[i] = f->second_mps[i] + ROOT_3 * (f->first_mps[i] - f->second_mps[i]);
    }
    found[0] = along * is->east - other[0] * is->north;
    found[1] = along * is->north + other[0] * is->east;
    found[2] = other[1];
    const double *gust = happening_at(f, GUST, at_s);
    if (gust) {
        found[0] += gust[3] * is->east;
        found[1] += gust[3] * is->north;
    }
}

void imu_bias(const flight_t *f, double bias_dps[AXES]) {
    const double *bias = signal_of(f, GYRO_BIAS_DPS), *warm_up = signal_of(f, GYRO_WARM_UP_DPS);
    const double *step = happening_at(f, BIAS, now_s(f)), cold = expm1(-now_s(f) / f->is->warm_up_s);
    for (int32_t i = 0; i < AXES; i++) {
        const bool stepped = step && (uint32_t)step[4] >> i & 1U;
        bias_dps[i] = bias[i] + (stepped ? step[3] : 0.0) - warm_up[i] * cold;
    }
}

void imu_counts(const flight_t *f, int16_t *counts) {
    const numbers_t *is = f->is;
    const double *matrix = signal_of(f, GYRO_MATRIX), *offset_g = signal_of(f, ACCEL_OFFSET_G);
    const double *white = noise_now(f);
    double bias_dps[AXES];
    imu_bias(f, bias_dps);
    for (int32_t i = 0; i < AXES; i++) {
        const double rate = dot(&matrix[AXES * i], f->felt_dps) + bias_dps[i] + is->gyro_noise_dps * white[i];
        const double force = f->felt_g[i] + offset_g[i] + is->accel_noise_g * white[AXES + i];
        counts[i] = (int16_t)clip(rint(rate / is->gyro_unit), is->gyro_least, is->gyro_most);
        counts[AXES + i] = (int16_t)clip(rint(force / is->accel_unit), is->accel_least, is->accel_most);
    }
}
