/* The blocks of the core alone, called over arrays as batch.c has it: filter, controller, angles, tilt,
 * reciprocal, digest. */
#include "core/angle.h"
#include "core/digest.h"
#include "core/kalman.h"
#include "core/pid.h"
#include "core/tilt.h"
#include "entry.h"

EXPORT int32_t plumb_sizeof_kalman(void);
EXPORT int32_t plumb_sizeof_pid(void);
EXPORT void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                             const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                             int32_t *fused_turn_q32);
EXPORT void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                              const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32,
                          const int32_t *rate_turnps_q28, int32_t steps, uint8_t *states);
EXPORT void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                           const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_pid_retune_each(const uint32_t *from, const uint32_t *to, void *states, int32_t n);
EXPORT void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32);
EXPORT void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32);
EXPORT void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30);
EXPORT void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half);
EXPORT void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                           int32_t n, int32_t *turn_q32, uint32_t *variance);
EXPORT void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61);
EXPORT uint32_t plumb_crc32(const uint8_t *data, int32_t bytes);

int32_t plumb_sizeof_kalman(void) {
    return (int32_t)sizeof(plumb_kalman_t);
}

int32_t plumb_sizeof_pid(void) {
    return (int32_t)sizeof(plumb_pid_t);
}

/* The filter alone: runs filters over steps samples. Inputs and fused are [steps][runs]; states:
 * plumb_kalman_t[runs], initialised here from params; on return the final states. The filters of a step are
 * independent, so the processor can work on several at once. */
void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                      const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                      int32_t *fused_turn_q32) {
    const plumb_params_t p = params_of(params);
    plumb_kalman_t *k = states;
    for (int32_t run = 0; run < runs; run++) {
        plumb_kalman_init(&k[run], &p.start);
    }
    for (int32_t i = 0; i < steps; i++) {
        const size_t at = (size_t)i * (size_t)runs;
        for (int32_t run = 0; run < runs; run++) {
            const size_t j = at + (size_t)run;
            kalman_step(&k[run], &p.kalman, variance[j], tilt_turn_q32[j], rate_turnps_q28[j]);
            fused_turn_q32[j] = kalman_tilt(&k[run]);
        }
    }
}

/* One step of each of n states (plumb_kalman_t). */
void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                       const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n) {
    const plumb_params_t p = params_of(params);
    plumb_kalman_t *k = states;
    for (int32_t i = 0; i < n; i++) {
        kalman_step(&k[i], &p.kalman, variance[i], tilt_turn_q32[i], rate_turnps_q28[i]);
    }
}

/* The controller alone, from its start. states: plumb_pid_t[steps], the state after every step. */
void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32, const int32_t *rate_turnps_q28,
                   int32_t steps, uint8_t *states) {
    const plumb_params_t p = params_of(params);
    plumb_pid_t c;
    plumb_pid_init(&c);
    for (int32_t i = 0; i < steps; i++) {
        pid_step(&c, &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
        memcpy(states + (size_t)i * sizeof c, &c, sizeof c);
    }
}

/* One step of each of n states (plumb_pid_t). */
void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                    const int32_t *rate_turnps_q28, int32_t n) {
    const plumb_params_t p = params_of(params);
    plumb_pid_t *c = states;
    for (int32_t i = 0; i < n; i++) {
        pid_step(&c[i], &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
    }
}

/* Other gains for each of n states (plumb_pid_t). */
void plumb_pid_retune_each(const uint32_t *from, const uint32_t *to, void *states, int32_t n) {
    const plumb_params_t before = params_of(from), after = params_of(to);
    plumb_pid_t *c = states;
    for (int32_t i = 0; i < n; i++) {
        plumb_pid_retune(&c[i], &before.pid, &after.pid);
    }
}

void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = angle_atan2(y[i], x[i]);
    }
}

void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = angle_asin(x_q30[i]);
    }
}

void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30) {
    for (int32_t i = 0; i < n; i++) {
        plumb_angle_sincos(turn_q32[i], &sin_q30[i], &cos_q30[i]);
    }
}

void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half) {
    for (int32_t i = 0; i < n; i++) {
        half[i] = plumb_angle_length(y[i], x[i]);
    }
}

/* Measured tilt and its variance. */
void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                    int32_t n, int32_t *turn_q32, uint32_t *variance) {
    const plumb_params_t p = params_of(params);
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = tilt_angle(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
        variance[i] = tilt_variance(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
    }
}

/* d: 2^30 .. 2^31 - 1 */
void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61) {
    for (int32_t i = 0; i < n; i++) {
        y_q61[i] = reciprocal_q61(d[i]);
    }
}

uint32_t plumb_crc32(const uint8_t *data, int32_t bytes) {
    return digest_crc32(data, (size_t)bytes);
}
