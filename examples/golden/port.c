/* A port of the C core, checked with the golden vectors: reads a vector from stdin, prints a digest for each
 * step.
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
#include <string.h>

static control_t control;
static plumb_params_t params;

/* The header; the steps that follow it, or -1 when it is not one. */
static long read_header(void) {
    char line[256], key[32], name[128];
    uint32_t words[sizeof params / sizeof(uint32_t)];
    size_t count = 0;
    int64_t value;

    while (fgets(line, sizeof line, stdin) != NULL && sscanf(line, "%31s %127s", key, name) == 2) {
        if (strcmp(key, "plumb-program") == 0 && strcmp(name, "1") != 0) {
            break; /* another version of the protocol */
        } else if (strcmp(key, "param") == 0 && count < sizeof words / sizeof words[0] &&
                   sscanf(line, "%*s %*s %" SCNd64, &value) == 1) {
            words[count++] = (uint32_t)value;
        } else if (strcmp(key, "steps") == 0) {
            long steps;
            if (count != sizeof words / sizeof words[0] || sscanf(name, "%ld", &steps) != 1) {
                break; /* made for another layout of the parameters */
            }
            memcpy(&params, words, sizeof params);
            return control_params_valid(&params) ? steps : -1;
        }
    }
    return -1;
}

int main(void) {
    const long steps = read_header();

    if (steps < 0) {
        fprintf(stderr, "this is no vector for this port\n");
        return 1;
    }
    control_init(&control, &params);
    for (long step = 0; step < steps; step++) {
        int16_t raw[6];
        int32_t setpoint;
        if (scanf("%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd32, &raw[0],
                  &raw[1], &raw[2], &raw[3], &raw[4], &raw[5], &setpoint) != 7) {
            return 1;
        }
        control_step(&control, &params, raw, setpoint);
        printf("%08" PRIx32 "\n", digest_crc32(control_words(&control), control_words_bytes(&params)));
    }
    return 0;
}
