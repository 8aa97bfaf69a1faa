/* The shortest port that answers golden vectors: one system, the quad; its steps and retunes.
 *
 *     cc -std=c99 -Ifirmware -Ifirmware/include -o port examples/golden/quad.c firmware/core/[a-z]*.c \
 *         firmware/systems/[a-z]*.c firmware/generated/systems.c
 *     plumb golden check --board program:./port --vector 'quad_motion_*' --vector 'quad_retune_*'
 *
 * host/plumb/boards/program.py documents the lines; port.c answers every system and kind. Replace the calls
 * of plumb_quad_... by those of your port. */
#include "plumb/quad.h"
#include "core/digest.h"
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int main(void) {
    plumb_quad_t quad;
    plumb_params_t params, before;
    uint32_t words[sizeof params / sizeof(uint32_t)] = {0};
    int32_t setpoint;
    int16_t raw[PLUMB_RAW_MAX] = {0};
    char line[4096], *at;
    for (size_t count = 0; fgets(line, sizeof line, stdin) != NULL;) {
        if (strncmp(line, "kind ", 5) == 0 && strcmp(line, "kind retune\n") != 0) {
            return fputs("this port has steps and retunes alone: choose them with --vector\n", stderr), 1;
        }
        if (strncmp(line, "param ", 6) == 0 && count < sizeof words / sizeof words[0]) {
            words[count++] = (uint32_t)strtoll(strrchr(line, ' '), NULL, 10);
        }
        if (strncmp(line, "steps ", 6) == 0) {
            memcpy(&params, words, sizeof params);
            if (!plumb_quad_params_valid(&params)) {
                return 1;
            }
            plumb_quad_init(&quad, &params);
        } else if (strncmp(line, "retune ", 7) == 0) {
            at = line + 7;
            for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
                words[i] = (uint32_t)strtoll(at, &at, 10);
            }
            before = params;
            memcpy(&params, words, sizeof params);
            plumb_quad_retune(&quad, &before, &params);
        } else if (sscanf(line, "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd16 "%" SCNd32,
                          &raw[0], &raw[1], &raw[2], &raw[3], &raw[4], &raw[5], &setpoint) == 7) {
            plumb_quad_step(&quad, &params, raw, setpoint);
            printf("%08" PRIx32 "\n", digest_crc32(&quad.words, sizeof quad.words));
        }
    }
}
