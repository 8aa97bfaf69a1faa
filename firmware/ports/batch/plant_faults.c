/* Faults in the counts of a sensor with a bus, for plants in C: plumb.physics.sensors.Fault.counts. */
#include "plant.h"
#include <math.h>

#define NO_SAMPLE     (-32768.0)
#define FLICKER_SIGMA 2.4
#define AMPLIFIED     8.0

static double instead_of(double lsb, plant_fault_kind_t kind, double frozen_lsb, double noise,
                         double noise_lsb, double rail_lsb) {
    switch (kind) {
    case PLANT_FAULT_RAILED:
        return rail_lsb;
    case PLANT_FAULT_STUCK:
        return frozen_lsb;
    case PLANT_FAULT_NOISY:
        return lsb + noise_lsb * noise;
    case PLANT_FAULT_FLICKERING:
        return fabs(noise) > FLICKER_SIGMA ? rail_lsb : lsb;
    case PLANT_FAULT_AMPLIFIED:
        return lsb * AMPLIFIED;
    case PLANT_FAULT_MISSING:
        return NO_SAMPLE;
    case PLANT_FAULT_SILENT:
        break;
    }
    return 0.0;
}

void plant_fail(const plant_run_t *run, plant_frozen_t *frozen, double time_s, int16_t *counts,
                const double *noise, double noise_lsb, double rail_lsb) {
    for (int32_t i = 0; i < run->fault_count; i++) {
        const plant_fault_t *fault = &run->faults[i];
        const int32_t channel = (int32_t)fault->channel;
        if (time_s < fault->start_s) {
            continue;
        }
        if (!frozen->begun[i]) {
            frozen->begun[i] = true;
            frozen->lsb[i] = counts[channel];
        }
        if (time_s >= fault->stop_s) {
            continue;
        }
        const double lsb = rint(instead_of(counts[channel], (plant_fault_kind_t)fault->kind, frozen->lsb[i],
                                           noise[channel * run->steps], noise_lsb, rail_lsb));
        counts[channel] = (int16_t)(lsb < -32768.0 ? -32768.0 : lsb > 32767.0 ? 32767.0 : lsb);
    }
}
