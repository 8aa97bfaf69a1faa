/* Whole runs of a system and its plant in C: the loop of plumb.proof.runs.closed_loop for batches of runs. */
#include "entry.h"
#include "plant.h"

#define OUTPUTS_MAX 16

/* One run from its start. state: memory of the plant, plant->bytes. params: plumb_params_t as 32-bit words.
 * places: of the words of the record that drive the plant, in 32-bit words; outputs: their number.
 * setpoint: [steps], written where the plant gives it. raw: [steps][inputs of the system], on entry the
 * inputs of a step without a sample. words: [steps][bytes of the record], truth: [steps][plant->truths].
 * Returns 0 for more outputs or faults than it has room for. */
EXPORT int32_t plumb_closed_loop(const plant_t *plant, const plant_run_t *run, void *state,
                                 const uint32_t *params, const int32_t *places, int32_t outputs,
                                 int32_t period_us, int32_t *setpoint, int16_t *raw, uint8_t *words,
                                 double *truth);

int32_t plumb_closed_loop(const plant_t *plant, const plant_run_t *run, void *state, const uint32_t *params,
                          const int32_t *places, int32_t outputs, int32_t period_us, int32_t *setpoint,
                          int16_t *raw, uint8_t *words, double *truth) {
    plumb_params_t p;
    memcpy(&p, params, sizeof p);
    const size_t bytes = control_words_bytes(&p), inputs = control_system(&p)->inputs;
    int32_t output[OUTPUTS_MAX];
    if (outputs > OUTPUTS_MAX || run->fault_count > PLANT_FAULTS_MAX) {
        return 0;
    }
    control_t c;
    control_init(&c, &p);
    plant->begin(state, run);
    for (int32_t i = 0; i < run->steps; i++) {
        const double time_s = (double)((int64_t)i * period_us) * 1e-6;
        plant->follow(state, time_s, i ? output : NULL);
        plant->sample(state, i, time_s, raw, truth);
        if (plant->setpoint) {
            setpoint[i] = plant->setpoint(state);
        }
        control_step(&c, &p, raw, setpoint[i]);
        memcpy(words, control_words(&c), bytes);
        for (int32_t n = 0; n < outputs; n++) {
            memcpy(&output[n], words + 4U * (size_t)places[n], sizeof output[n]);
        }
        raw += inputs;
        words += bytes;
        truth += plant->truths;
    }
    return 1;
}
