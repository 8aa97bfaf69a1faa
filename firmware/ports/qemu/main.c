/* The core alone on a Cortex-M of QEMU: reads the inputs from a file and writes every step's words and digest
 * to a file, by semihosting. Both files are in QEMU's working directory; all numbers are little endian.
 *
 * "plumb-in.bin":  uint32 magic, uint32 parameter words, uint32 parts, then the parts of the run, each:
 *                  uint32 steps, the parameter words that these steps use,
 *                  per step int16 raw[6], int32 setpoint
 * "plumb-out.bin": uint32 magic, uint32 bytes of a step's words,
 *                  then per step the words (control_words()), uint32 digest
 *
 * The exit code of QEMU is a run_result_t. */
#include "core/digest.h"
#include "semihosting.h"
#include "systems/control.h"
#include <stddef.h>
#include <string.h>

#define MAGIC_IN    0x49424C50U /* "PLBI" */
#define MAGIC_OUT   0x4F424C50U /* "PLBO" */
#define BATCH_STEPS 8U          /* as many as the smallest machine has room for */

typedef enum {
    RUN_GOOD = 0,
    RUN_NO_INPUT = 10,     /* the input file cannot be opened, or ends early */
    RUN_OTHER_LAYOUT = 11, /* made for another parameter layout */
    RUN_REFUSED = 12,      /* control_params_valid() returned false */
    RUN_NO_OUTPUT = 13,    /* the output file cannot be written */
} run_result_t;

typedef struct {
    int16_t raw[PLUMB_RAW_MAX];
    int32_t setpoint;
} sample_t;

typedef struct {
    uint32_t magic;
    uint32_t parameter_words;
    uint32_t parts;
} input_header_t;

static control_t control;
static plumb_params_t params;
static sample_t samples[BATCH_STEPS];
static uint8_t answers[BATCH_STEPS * (sizeof(control_words_t) + sizeof(uint32_t))];

/* Runs steps with the parameters in use. */
static run_result_t run_steps(int32_t input, int32_t output, uint32_t steps) {
    const uint32_t bytes = (uint32_t)control_words_bytes(&params);
    for (uint32_t left = steps; left > 0;) {
        const uint32_t batch = left < BATCH_STEPS ? left : BATCH_STEPS;
        if (!semihosting_read(input, samples, batch * sizeof samples[0])) {
            return RUN_NO_INPUT;
        }
        uint8_t *answer = answers;
        for (uint32_t i = 0; i < batch; i++) {
            control_step(&control, &params, samples[i].raw, samples[i].setpoint);
            const uint32_t digest = digest_crc32(control_words(&control), bytes);
            memcpy(answer, control_words(&control), bytes);
            memcpy(answer + bytes, &digest, sizeof digest);
            answer += bytes + sizeof digest;
        }
        if (!semihosting_write(output, answers, (uint32_t)(answer - answers))) {
            return RUN_NO_OUTPUT;
        }
        left -= batch;
    }
    return RUN_GOOD;
}

/* The first part begins the run; the others go on from its state with other parameters of the same system. */
static run_result_t run_part(int32_t input, int32_t output, bool first) {
    const plumb_params_t before = params;
    uint32_t steps;
    if (!semihosting_read(input, &steps, sizeof steps) || !semihosting_read(input, &params, sizeof params)) {
        return RUN_NO_INPUT;
    }
    if (!control_params_valid(&params) || (!first && params.system != before.system)) {
        return RUN_REFUSED;
    }
    if (first) {
        const uint32_t head[2] = {MAGIC_OUT, (uint32_t)control_words_bytes(&params)};
        if (!semihosting_write(output, head, sizeof head)) {
            return RUN_NO_OUTPUT;
        }
        control_init(&control, &params);
    } else {
        control_retune(&control, &before, &params);
    }
    return run_steps(input, output, steps);
}

static run_result_t run(int32_t input, int32_t output) {
    run_result_t result = RUN_GOOD;
    input_header_t header;
    if (!semihosting_read(input, &header, sizeof header) || header.magic != MAGIC_IN) {
        return RUN_NO_INPUT;
    }
    if (header.parameter_words != sizeof params / sizeof(uint32_t)) {
        return RUN_OTHER_LAYOUT;
    }
    for (uint32_t part = 0; part < header.parts && result == RUN_GOOD; part++) {
        result = run_part(input, output, part == 0);
    }
    return result;
}

int main(void) {
    const int32_t input = semihosting_open("plumb-in.bin", false);
    if (input < 0) {
        return RUN_NO_INPUT;
    }
    const int32_t output = semihosting_open("plumb-out.bin", true);
    if (output < 0) {
        return RUN_NO_OUTPUT;
    }
    const run_result_t result = run(input, output);
    semihosting_close(input);
    semihosting_close(output);
    return (int)result;
}
