/* A port of the C core, checked with the golden vectors: reads a vector from stdin, prints a digest for each
 * step, or for each table of parameters.
 *
 *     cc -std=c99 -Ifirmware -Ifirmware/include -o port examples/golden/port.c firmware/core/[a-z]*.c \
 *         firmware/systems/[a-z]*.c firmware/generated/systems.c
 *     plumb golden check --board program:./port
 *
 * host/plumb/boards/program.py documents the lines. Replace the calls of control_... by those of your port.
 */
#include "core/digest.h"
#include "systems/control.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WORDS (sizeof(plumb_params_t) / sizeof(uint32_t))

static control_t control;
static plumb_params_t params;
static char kind[16] = "step", line[4096];
static uint32_t variance_turn2_q56;

/* The header; the steps that follow it, or -1 when it is not one for this port. */
static long read_header(void) {
    char key[32], name[128];
    uint32_t words[WORDS];
    size_t count = 0;
    int64_t value;

    while (fgets(line, sizeof line, stdin) != NULL && sscanf(line, "%31s %127s", key, name) == 2) {
        if (strcmp(key, "plumb-program") == 0 && strcmp(name, "1") != 0 && strcmp(name, "2") != 0) {
            break; /* another version of the protocol */
        } else if (strcmp(key, "kind") == 0) {
            (void)sscanf(name, "%15s", kind);
        } else if (strcmp(key, "variance_turn2_q56") == 0) {
            variance_turn2_q56 = (uint32_t)strtoul(name, NULL, 10);
        } else if (strcmp(key, "param") == 0 && count < WORDS &&
                   sscanf(line, "%*s %*s %" SCNd64, &value) == 1) {
            words[count++] = (uint32_t)value;
        } else if (strcmp(key, "steps") == 0) {
            memcpy(&params, words, sizeof params);
            return count == WORDS && control_params_valid(&params) ? strtol(name, NULL, 10) : -1;
        }
    }
    return -1;
}

/* The words of a line behind its key. */
static plumb_params_t table_of(const char *text) {
    uint32_t words[WORDS];
    plumb_params_t table;
    char *at = strchr(text, ' ');

    for (size_t i = 0; i < WORDS; i++) {
        words[i] = at == NULL ? 0U : (uint32_t)strtoll(at, &at, 10);
    }
    memcpy(&table, words, sizeof table);
    return table;
}

/* The digest of what plausibility knows after the step. */
static uint32_t plausibility(plumb_plausibility_t *s) {
    plumb_plausibility_step(s, control_system(&params)->plausibility, control_words(&control),
                            params.kalman.dt_s_q33, variance_turn2_q56);
    uint32_t words[16];
    memcpy(words, s, 12U * sizeof words[0]); /* its members of 32 bits; this port is little-endian */
    words[12] = s->begun;
    words[13] = s->converged;
    words[14] = s->failed;
    words[15] = s->missing;
    return digest_crc32(words, sizeof words);
}

/* The inputs of a step, of which a system has up to PLUMB_RAW_MAX, and its setpoint; false when these are
 * none. */
static bool inputs_of(char *text, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    long numbers[PLUMB_RAW_MAX + 1U];
    size_t count = 0;

    for (char *end = NULL; count <= PLUMB_RAW_MAX; text = end) {
        numbers[count] = strtol(text, &end, 10);
        if (end == text) {
            break;
        }
        count++;
    }
    for (size_t i = 0; i < PLUMB_RAW_MAX; i++) {
        raw[i] = i + 1U < count ? (int16_t)numbers[i] : 0;
    }
    *setpoint = count > 0 ? (int32_t)numbers[count - 1U] : 0;
    return count > 3;
}

/* The next step's inputs, after other parameters if there are any; false at the end. */
static bool read_step(int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    while (fgets(line, sizeof line, stdin) != NULL) {
        if (strncmp(line, "retune ", 7) == 0) {
            const plumb_params_t before = params;
            params = table_of(line);
            control_retune(&control, &before, &params);
        } else {
            return inputs_of(line, raw, setpoint);
        }
    }
    return false;
}

int main(void) {
    plumb_plausibility_t state;
    const long steps = read_header();

    if (steps < 0) {
        fprintf(stderr, "this is no vector for this port\n");
        return 1;
    }
    control_init(&control, &params);
    plumb_plausibility_init(&state);
    for (long step = 0; step < steps; step++) {
        int16_t raw[PLUMB_RAW_MAX];
        int32_t setpoint;
        uint32_t digest;
        if (strcmp(kind, "refusal") == 0) {
            if (fgets(line, sizeof line, stdin) == NULL) {
                return 1;
            }
            const plumb_params_t table = table_of(line);
            const uint32_t valid = control_params_valid(&table) ? 1U : 0U;
            digest = digest_crc32(&valid, sizeof valid);
        } else {
            if (!read_step(raw, &setpoint)) {
                return 1;
            }
            control_step(&control, &params, raw, setpoint);
            digest = strcmp(kind, "plausibility") == 0
                         ? plausibility(&state)
                         : digest_crc32(control_words(&control), control_words_bytes(&params));
        }
        printf("%08" PRIx32 "\n", digest);
    }
    return 0;
}
