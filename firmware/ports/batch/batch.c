/* The core as a shared library for Python: the same C as on the target, called over arrays.
 *
 * Every entry point takes pointers to plain integer arrays and counts. params is control_params_t as 32-bit
 * words. The
 * *_run functions keep one state over n steps; the *_each functions take n unrelated states, for inputs that
 * no run would reach. Arrays of steps and runs are [steps][runs].
 */
#include "core/angle.h"
#include "core/digest.h"
#include "systems/control.h"
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define PARAMS_WORDS (sizeof(control_params_t) / sizeof(uint32_t))

EXPORT const char *plumb_word_names(uint32_t system);
EXPORT int32_t plumb_sizeof_words(uint32_t system);
EXPORT int32_t plumb_sizeof_control(void);
EXPORT int32_t plumb_sizeof_kalman(void);
EXPORT int32_t plumb_sizeof_pid(void);
EXPORT int32_t plumb_params_count(void);
EXPORT int32_t plumb_params_valid(const uint32_t *params);
EXPORT void plumb_control_init(void *control, const uint32_t *params);
EXPORT void plumb_control_step(void *control, const uint32_t *params, const int16_t *raw, int32_t setpoint);
EXPORT void plumb_control_words(const void *control, const uint32_t *params, uint8_t *words);
EXPORT void plumb_control_run(const uint32_t *params, const int16_t *raw, const int32_t *setpoint,
                              int32_t steps, uint8_t *words, uint32_t *digests);
EXPORT void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                             const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                             int32_t *fused_turn_q32);
EXPORT void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                              const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32,
                          const int32_t *rate_turnps_q28, int32_t steps, uint8_t *states);
EXPORT void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                           const int32_t *rate_turnps_q28, int32_t n);
EXPORT void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32);
EXPORT void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32);
EXPORT void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30);
EXPORT void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half);
EXPORT void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                           int32_t n, int32_t *turn_q32, uint32_t *variance);
EXPORT void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61);
EXPORT int32_t plumb_plausibility_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                                      uint32_t variance_turn2_q56, uint16_t *failed, uint16_t *missing);
EXPORT uint32_t plumb_crc32(const uint8_t *data, int32_t bytes);

#define BALANCER_NAMES                                                                                       \
    "raw_0,raw_1,raw_2,raw_3,raw_4,raw_5,setpoint_mps_q26,rate_turnps_q28,accel_x_g_q26,accel_z_g_q26,"      \
    "speed_mps_q26,velocity_mps_q26,wheel_accel_g_q26,gravity_x_g_q26,tilt_measured_turn_q32,variance,"      \
    "tilt_turn_q61,bias_turn_q61,p00,p01,p11,p11_frac_q30,innovation_turn_q32,k0_q29,k1_q29,tilt_turn_q32,"  \
    "bias_turnps_q28,rate_corrected_turnps_q28,clamped_steps,speed_integral_q54,speed_command_q22,"          \
    "accel_filtered_g_q25,speed_excess_q22,speed_error_mps_q26,integral_q54,command_q22,"                    \
    "rate_filtered_turnps_q27,excess_q22,error_turn_q32,lean_turn_q32,duty_q15,flags,step"

#define QUAD_NAMES                                                                                           \
    "raw_0,raw_1,raw_2,raw_3,raw_4,raw_5,setpoint_turn_q32,rate_turnps_q28,accel_y_g_q26,accel_z_g_q26,"     \
    "tilt_measured_turn_q32,variance,tilt_turn_q61,bias_turn_q61,p00,p01,p11,p11_frac_q30,"                  \
    "innovation_turn_q32,k0_q29,k1_q29,tilt_turn_q32,bias_turnps_q28,rate_corrected_turnps_q28,"             \
    "clamped_steps,integral_q54,command_q22,rate_filtered_turnps_q27,excess_q22,error_turn_q32,"             \
    "pulse_halfus_0,pulse_halfus_1,flags,step"

#define PHONE_NAMES                                                                                          \
    "raw_0,raw_1,raw_2,raw_3,raw_4,raw_5,setpoint_turn_q32,rate_x_turnps_q28,rate_y_turnps_q28,"             \
    "rate_z_turnps_q28,accel_x_g_q26,accel_y_g_q26,accel_z_g_q26,tangent_q26,pitch_rate_turnps_q28,"         \
    "roll_rate_turnps_q28,pitch_measured_turn_q32,roll_measured_turn_q32,pitch_variance,"                    \
    "roll_variance,pitch_turn_q61,pitch_bias_turn_q61,pitch_p00,pitch_p01,pitch_p11,"                        \
    "pitch_p11_frac_q30,pitch_innovation_turn_q32,pitch_k0_q29,pitch_k1_q29,roll_turn_q61,"                  \
    "roll_bias_turn_q61,roll_p00,roll_p01,roll_p11,roll_p11_frac_q30,roll_innovation_turn_q32,"              \
    "roll_k0_q29,roll_k1_q29,pitch_turn_q32,pitch_bias_turnps_q28,pitch_rate_corrected_turnps_q28,"          \
    "roll_turn_q32,roll_bias_turnps_q28,roll_rate_corrected_turnps_q28,uncorrected_steps,"                   \
    "clamped_steps,flags,step"

#define THREE(name) name "_0," name "_1," name "_2,"
#define PREFILTER_NAMES(sensor)                                                                              \
    THREE(sensor "_last") THREE(sensor "_before") sensor "_spikes," sensor "_gap_steps,"
#define PARAMETER_NAMES(name, axis)                                                                          \
    name "_variance_q60_" axis "," name "_rate_q28_" axis "," name "_gyro_bias_q28_" axis "," name           \
         "_angular_bias_q28_" axis "," name "_angle_q28_" axis ","
#define QUATERNION_NAMES(name) name "_w_q30," name "_x_q30," name "_y_q30," name "_z_q30,"
#define TURNTABLE_NAMES                                                                                      \
    "raw_0,raw_1,raw_2,raw_3,raw_4,raw_5,setpoint," PREFILTER_NAMES("gyro") PREFILTER_NAMES("angular")       \
        THREE("rate_turnps_q28") THREE("acceleration_turnps2_q28") "gyro_age_step_q24," THREE(               \
            "increment_turnps_q34") THREE("increment_lagged_turnps_q34") THREE("innovation_turnps_q28")      \
            QUATERNION_NAMES("attitude") QUATERNION_NAMES("attitude_angular") THREE("rate_fused_turnps_q28") \
                THREE("rate_corrected_turnps_q28") THREE("bias_gyro_turnps_q34")                             \
                    THREE("bias_angular_turnps_q42") THREE("scale_q30")                                      \
                        THREE("lag_step_q24") "clamped_steps,p00_q64,p10_q64,p11_q64,p20_q64,p21_q64,"       \
                                              "p22_q64,p30_q64,p31_q64,p32_q64,p33_q64,p40_q64,p41_q64,p42_" \
                                              "q64,p43_q64," PARAMETER_NAMES("scale", "0")                   \
                                                  PARAMETER_NAMES("scale", "1")                              \
                                                      PARAMETER_NAMES("scale", "2")                          \
                                                          PARAMETER_NAMES("lag", "0")                        \
                                                              PARAMETER_NAMES("lag", "1")                    \
                                                                  PARAMETER_NAMES("lag", "2") "flags,step"

/* The words of a system's step in the order of its record; arrays as name_index. NULL: there is no such
 * system. */
const char *plumb_word_names(uint32_t system) {
    switch (system) {
    case CONTROL_QUAD:
        return QUAD_NAMES;
    case CONTROL_BALANCER:
        return BALANCER_NAMES;
    case CONTROL_PHONE:
        return PHONE_NAMES;
    case CONTROL_TURNTABLE:
        return TURNTABLE_NAMES;
    default:
        return NULL;
    }
}

int32_t plumb_sizeof_words(uint32_t system) {
    const control_params_t p = {.system = system};
    return (int32_t)control_words_bytes(&p);
}

int32_t plumb_sizeof_control(void) {
    return (int32_t)sizeof(control_t);
}

int32_t plumb_sizeof_kalman(void) {
    return (int32_t)sizeof(kalman_t);
}

int32_t plumb_sizeof_pid(void) {
    return (int32_t)sizeof(pid_t);
}

int32_t plumb_params_count(void) {
    return (int32_t)PARAMS_WORDS;
}

static control_params_t params_of(const uint32_t *words) {
    control_params_t p;
    memcpy(&p, words, sizeof p);
    return p;
}

int32_t plumb_params_valid(const uint32_t *params) {
    const control_params_t p = params_of(params);
    return control_params_valid(&p);
}

/* One step at a time, for a closed loop. control: plumb_sizeof_control() bytes, aligned to 8. */
void plumb_control_init(void *control, const uint32_t *params) {
    const control_params_t p = params_of(params);
    control_init(control, &p);
}

void plumb_control_step(void *control, const uint32_t *params, const int16_t *raw, int32_t setpoint) {
    const control_params_t p = params_of(params);
    control_step(control, &p, raw, setpoint);
}

void plumb_control_words(const void *control, const uint32_t *params, uint8_t *words) {
    const control_params_t p = params_of(params);
    memcpy(words, control_words(control), control_words_bytes(&p));
}

/* A whole run from its start. raw: [steps][6]; words: [steps][plumb_sizeof_words(system)], may be NULL;
 * digests: [steps], may be NULL. */
void plumb_control_run(const uint32_t *params, const int16_t *raw, const int32_t *setpoint, int32_t steps,
                       uint8_t *words, uint32_t *digests) {
    const control_params_t p = params_of(params);
    const size_t bytes = control_words_bytes(&p);
    control_t c;
    control_init(&c, &p);
    for (int32_t i = 0; i < steps; i++) {
        control_step(&c, &p, raw + (size_t)i * CONTROL_RAW_MAX, setpoint[i]);
        if (words)
            memcpy(words + (size_t)i * bytes, control_words(&c), bytes);
        if (digests)
            digests[i] = digest_crc32(control_words(&c), bytes);
    }
}

/* The filter alone: runs filters over steps samples. Inputs and fused are [steps][runs]; states:
 * kalman_t[runs], set to the start of params here and left as they end. Filters of one step do not depend on
 * each other: the processor works on several at once. */
void plumb_kalman_run(const uint32_t *params, const uint32_t *variance, const int32_t *tilt_turn_q32,
                      const int32_t *rate_turnps_q28, int32_t steps, int32_t runs, void *states,
                      int32_t *fused_turn_q32) {
    const control_params_t p = params_of(params);
    kalman_t *k = states;
    for (int32_t run = 0; run < runs; run++)
        kalman_init(&k[run], &p.start);
    for (int32_t i = 0; i < steps; i++) {
        const size_t at = (size_t)i * (size_t)runs;
        for (int32_t run = 0; run < runs; run++) {
            const size_t j = at + (size_t)run;
            kalman_step(&k[run], &p.kalman, variance[j], tilt_turn_q32[j], rate_turnps_q28[j]);
            fused_turn_q32[j] = kalman_tilt(&k[run]);
        }
    }
}

/* One step of each of n states (kalman_t). */
void plumb_kalman_each(const uint32_t *params, void *states, const uint32_t *variance,
                       const int32_t *tilt_turn_q32, const int32_t *rate_turnps_q28, int32_t n) {
    const control_params_t p = params_of(params);
    kalman_t *k = states;
    for (int32_t i = 0; i < n; i++)
        kalman_step(&k[i], &p.kalman, variance[i], tilt_turn_q32[i], rate_turnps_q28[i]);
}

/* The controller alone, from its start. states: pid_t[steps], the state after every step. */
void plumb_pid_run(const uint32_t *params, const int32_t *error_turn_q32, const int32_t *rate_turnps_q28,
                   int32_t steps, uint8_t *states) {
    const control_params_t p = params_of(params);
    pid_t c;
    pid_init(&c);
    for (int32_t i = 0; i < steps; i++) {
        pid_step(&c, &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
        memcpy(states + (size_t)i * sizeof c, &c, sizeof c);
    }
}

/* One step of each of n states (pid_t). */
void plumb_pid_each(const uint32_t *params, void *states, const int32_t *error_turn_q32,
                    const int32_t *rate_turnps_q28, int32_t n) {
    const control_params_t p = params_of(params);
    pid_t *c = states;
    for (int32_t i = 0; i < n; i++)
        pid_step(&c[i], &p.pid, error_turn_q32[i], rate_turnps_q28[i]);
}

void plumb_atan2_run(const int32_t *y, const int32_t *x, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++)
        turn_q32[i] = angle_atan2(y[i], x[i]);
}

void plumb_asin_run(const int32_t *x_q30, int32_t n, int32_t *turn_q32) {
    for (int32_t i = 0; i < n; i++)
        turn_q32[i] = angle_asin(x_q30[i]);
}

void plumb_sincos_run(const int32_t *turn_q32, int32_t n, int32_t *sin_q30, int32_t *cos_q30) {
    for (int32_t i = 0; i < n; i++)
        angle_sincos(turn_q32[i], &sin_q30[i], &cos_q30[i]);
}

void plumb_length_run(const int32_t *y, const int32_t *x, int32_t n, uint32_t *half) {
    for (int32_t i = 0; i < n; i++)
        half[i] = angle_length(y[i], x[i]);
}

/* Measured tilt and its variance. */
void plumb_tilt_run(const uint32_t *params, const int32_t *accel_y_g_q26, const int32_t *accel_z_g_q26,
                    int32_t n, int32_t *turn_q32, uint32_t *variance) {
    const control_params_t p = params_of(params);
    for (int32_t i = 0; i < n; i++) {
        turn_q32[i] = tilt_angle(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
        variance[i] = tilt_variance(&p.tilt, accel_y_g_q26[i], accel_z_g_q26[i]);
    }
}

/* d: 2^30 .. 2^31 - 1 */
void plumb_reciprocal_run(const uint32_t *d, int32_t n, uint32_t *y_q61) {
    for (int32_t i = 0; i < n; i++)
        y_q61[i] = reciprocal_q61(d[i]);
}

uint32_t plumb_crc32(const uint8_t *data, int32_t bytes) {
    return digest_crc32(data, (size_t)bytes);
}

/* The plausibility of a run, from the records of its steps. 0: this system has none to check. */
int32_t plumb_plausibility_run(const uint32_t *params, const uint8_t *words, int32_t steps,
                               uint32_t variance_turn2_q56, uint16_t *failed, uint16_t *missing) {
    control_params_t p;
    control_words_t record;
    plausibility_t state;

    memcpy(&p, params, sizeof p);
    const plausibility_bounds_t *const bounds = control_plausibility(&p);
    if (bounds == NULL)
        return 0;
    plausibility_init(&state);
    for (int32_t k = 0; k < steps; k++) {
        memcpy(&record, words + (size_t)k * control_words_bytes(&p), control_words_bytes(&p));
        plausibility_step(&state, bounds, &record, p.kalman.dt_s_q33, variance_turn2_q56);
        failed[k] = state.failed;
        missing[k] = state.missing;
    }
    return 1;
}
