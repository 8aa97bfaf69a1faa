/* A seed for random numbers that is another one at every start, on a part without a generator of them.
 *
 * After a reset: a word that survives it goes on along a sequence of 2^32 words. After power-up: that word,
 * and the memory that nothing uses, hold what the cells fell into, some of it by chance. Neither is a secret.
 */
#include "entropy.h"
#include "linker.h"

#define RAM_END  ((const uint32_t *)0x20005000u) /* of the smallest part, 20 KiB */
#define FNV      16777619u                       /* FNV-1a, word by word */
#define STRIDE   1664525u                        /* with an odd addend: all 2^32 words, then again */
#define INCREASE 1013904223u

static uint32_t starts __attribute__((section(".noinit")));

uint32_t entropy_at_start(void) {
    uint32_t hash = starts;
    for (const uint32_t *word = ram_end; word < RAM_END; word++) {
        hash = (hash ^ *word) * FNV;
    }
    starts = starts * STRIDE + INCREASE;
    return hash;
}
