/* Runs a fuzz target without libFuzzer: every file of a folder, then mutations of them in a fixed sequence.
 *
 *     fuzz_session_replay FOLDER ROUNDS     mutated inputs: ROUNDS
 *     fuzz_session_replay FILE 0            one input
 *
 * An input that fails is written in hexadecimal, as tests/fuzz/make_corpus.py takes it. */
#define _POSIX_C_SOURCE 200809L
#include "input.h"
#include <dirent.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>

#define FILES_MAX 256U

typedef struct {
    uint8_t bytes[INPUT_MAX];
    size_t size;
} input_t;

static input_t seeds[FILES_MAX], now;
static size_t seed_count;

static void on_abort(int number) {
    (void)number;
    (void)fputs("input: ", stderr);
    for (size_t i = 0; i < now.size; i++) {
        (void)fprintf(stderr, "%02x", (unsigned)now.bytes[i]);
    }
    (void)fputs("\n", stderr);
}

static void run(const input_t *input) {
    now = *input;
    (void)LLVMFuzzerTestOneInput(now.bytes, now.size);
}

static void read_file(const char *path) {
    FILE *const file = fopen(path, "rb");
    REQUIRE(file != NULL && seed_count < FILES_MAX);
    seeds[seed_count].size = fread(seeds[seed_count].bytes, 1, INPUT_MAX, file);
    seed_count++;
    (void)fclose(file);
}

/* A fixed sequence: upper half of a 64-bit linear congruence (Knuth's MMIX constants). */
static uint32_t drawn(void) {
    static uint64_t state = 1;
    state = state * 6364136223846793005U + 1442695040888963407U;
    return (uint32_t)(state >> 32);
}

static int visible(const struct dirent *entry) {
    return entry->d_name[0] != '.';
}

/* A file, or all files of a folder by name: the sequence is the same everywhere. */
static void read_seeds(const char *path) {
    struct stat about;
    REQUIRE(stat(path, &about) == 0);
    if (!S_ISDIR(about.st_mode)) {
        read_file(path);
        return;
    }
    struct dirent **entries;
    const int count = scandir(path, &entries, visible, alphasort);
    REQUIRE(count > 0);
    for (int i = 0; i < count; i++) {
        char file[4096];
        REQUIRE(snprintf(file, sizeof file, "%s/%s", path, entries[i]->d_name) < (int)sizeof file);
        read_file(file);
        free(entries[i]);
    }
    free(entries);
}

static size_t below(size_t bound) {
    return bound > 0 ? drawn() % bound : 0;
}

/* One of the ways in which libFuzzer changes an input, too. */
static void mutate(input_t *input) {
    const size_t at = below(input->size);
    const input_t *const other = &seeds[below(seed_count)];
    size_t from, count;

    switch (drawn() % 5U) {
    case 0: /* a bit */
        input->bytes[at] = (uint8_t)(input->bytes[at] ^ 1U << drawn() % 8U);
        break;
    case 1: /* a byte */
        input->bytes[at] = (uint8_t)(drawn() & 0xFFU);
        break;
    case 2: /* some bytes less */
        count = below(input->size - at);
        memmove(&input->bytes[at], &input->bytes[at + count], input->size - at - count);
        input->size -= count;
        break;
    case 3: /* some bytes of an input over others */
        from = below(other->size);
        count = below((other->size - from < INPUT_MAX - at ? other->size - from : INPUT_MAX - at) + 1U);
        memcpy(&input->bytes[at], &other->bytes[from], count);
        input->size = at + count > input->size ? at + count : input->size;
        break;
    default: /* some bytes of an input between others */
        from = below(other->size);
        count = below(other->size - from + 1U);
        count = count < INPUT_MAX - input->size ? count : INPUT_MAX - input->size;
        memmove(&input->bytes[at + count], &input->bytes[at], input->size - at);
        memcpy(&input->bytes[at], &other->bytes[from], count);
        input->size += count;
    }
}

int main(int argc, char **argv) {
    REQUIRE(argc == 3);
    read_seeds(argv[1]);
    (void)signal(SIGABRT, on_abort);
    for (size_t i = 0; i < seed_count; i++) {
        run(&seeds[i]);
    }
    const long rounds = strtol(argv[2], NULL, 10);
    for (long round = 0; round < rounds; round++) {
        static input_t input;
        input = seeds[below(seed_count)];
        for (size_t i = 0; i < 1U + below(6U); i++) {
            mutate(&input);
        }
        run(&input);
    }
    (void)printf("%zu files and %ld mutations held\n", seed_count, rounds);
    return 0;
}
