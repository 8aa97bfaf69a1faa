/* A plant in C, so that a campaign closes its loops without leaving C: host/plumb/systems/NAME/plant.c
 * and, where it is long, plant_*.c beside it.
 *
 * It repeats the Python plant of the system operation by operation, in IEEE double and with the functions of
 * the same C library, so that both give the same counts to the bit. All random numbers come from Python, so
 * that a seed means the same run. plant.c is compiled without contraction and without the
 * compiler's own functions. */
#ifndef PLUMB_PORTS_BATCH_PLANT_H
#define PLUMB_PORTS_BATCH_PLANT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PLANT_FAULTS_MAX 32

typedef enum {
    PLANT_FAULT_RAILED = 0,
    PLANT_FAULT_STUCK,
    PLANT_FAULT_NOISY,
    PLANT_FAULT_SILENT,
    PLANT_FAULT_FLICKERING, /* this and what follows: of sensors with a bus alone */
    PLANT_FAULT_AMPLIFIED,
    PLANT_FAULT_MISSING
} plant_fault_kind_t;

/* A fault of a sensor, as a row of numbers: a kind of plant_fault_kind_t, a channel, and start <= time <
 * stop. */
typedef struct {
    double kind, channel, start_s, stop_s;
} plant_fault_t;

/* The counts that a channel had when its fault began, for each fault. */
typedef struct {
    double lsb[PLANT_FAULTS_MAX];
    bool begun[PLANT_FAULTS_MAX];
} plant_frozen_t;

/* One drawn run. numbers, signals: in the order that the plant names them. */
typedef struct {
    const double *numbers;
    const double *const *signals;
    const plant_fault_t *faults;
    int32_t fault_count; /* at most PLANT_FAULTS_MAX */
    int32_t steps;       /* samples of the run */
    int32_t points;      /* values of a signal on the grid of the simulated physics */
} plant_run_t;

typedef struct {
    const char *numbers, *signals, *truth; /* their names, comma between them */
    size_t bytes;                          /* of the state */
    int32_t truths;                        /* numbers of the true state */
    /* The state before the first sample. */
    void (*begin)(void *plant, const plant_run_t *run);
    /* Simulate up to time_s with the outputs of the last step; NULL before the first step. */
    void (*follow)(void *plant, double time_s, const int32_t *outputs);
    /* Raw counts of sample k at time_s, and the true state then. */
    void (*sample)(void *plant, int32_t k, double time_s, int16_t *counts, double *truth);
    /* Setpoint of the sample that was taken last, from a pilot who sees the vehicle; NULL: setpoints are
     * given before the run. Such a pilot's commands are further counts of the sample. */
    int32_t (*setpoint)(const void *plant);
} plant_t;

/* Put the faults of a run into the counts of the sample at time_s, in their order. noise: unit noise of
 * channel c at noise[c * run->steps]; noise_lsb: its size where it is added; rail_lsb: the end of the scale.
 */
void plant_fail(const plant_run_t *run, plant_frozen_t *frozen, double time_s, int16_t *counts,
                const double *noise, double noise_lsb, double rail_lsb);

#endif
