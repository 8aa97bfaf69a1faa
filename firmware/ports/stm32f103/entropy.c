/* Seed for random numbers that differs at every start, on a part without a random number generator.
 *
 * After a reset: a word that survives the reset advances along a sequence of 2^32 words. After power-up: that
 * word and the unused memory hold the random power-up state of the RAM cells. The seed is no secret. */
#include "entropy.h"
#include "linker.h"

#define RAM_END  ((const uint32_t *)0x20005000U) /* of the smallest part, 20 KiB */
#define FNV      16777619U                       /* FNV-1a, word by word */
#define STRIDE   1664525U                        /* with an odd increment the period is 2^32 */
#define INCREASE 1013904223U

static uint32_t starts __attribute__((section(".noinit")));

uint32_t entropy_at_start(void) {
    uint32_t hash = starts;
    for (const uint32_t *word = ram_end; word < RAM_END; word++) {
        hash = (hash ^ *word) * FNV;
    }
    starts = starts * STRIDE + INCREASE;
    return hash;
}
