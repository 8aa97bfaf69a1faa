/* CRC-32 by the chip's CRC unit (RM0008 4). Implements core/digest.h in place of core/digest.c, which the
 * linker leaves out.
 *
 * The unit divides by 0x04C11DB7, a word at a time, highest bit first. CRC-32 takes the lowest bit first, so
 * words go in bit-reversed and the remainder comes out bit-reversed. The unit has a single remainder, so only
 * the main loop may use it. */
#include "crc.h"
#include "core/digest.h"
#include "stm32f103.h"

#define REFLECTED 0xedb88320U

static void begin(void) {
    RCC_AHBENR |= RCC_AHBENR_CRCEN; /* also before board_init(): saved parameters are read first */
    CRC_CR = CRC_CR_RESET;
}

uint32_t crc_of_words(const uint32_t *from, const uint32_t *end) {
    begin();
    if (from != end) {
        /* Whole groups of eight words (stm32f103.ld aligns to 32 bytes) in 32 cycles each, the unit's own
         * time: loads, comparison and jump fill the three cycles in which it is busy with a word. The last
         * turn loads two words behind the end, and does not use them. */
        __asm volatile("ldmia %0!, {r3, r4} \n"
                       ".p2align 3 \n"
                       "1: str r3, [%1] \n"
                       "ldmia %0!, {r5, r6} \n"
                       "str r4, [%1] \n"
                       "str r5, [%1] \n"
                       "ldmia %0!, {r3, r4} \n"
                       "str r6, [%1] \n"
                       "str r3, [%1] \n"
                       "ldmia %0!, {r5, r6} \n"
                       "str r4, [%1] \n"
                       "cmp %0, %2 \n"
                       "str r5, [%1] \n"
                       "ldmia %0!, {r3, r4} \n"
                       "str r6, [%1] \n"
                       "bne 1b"
                       : "+l"(from)
                       : "l"(&CRC_DR), "l"(end)
                       : "r3", "r4", "r5", "r6", "cc", "memory");
    }
    return CRC_DR;
}

uint32_t digest_crc32(const void *data, size_t bytes) {
    begin();
    const uint8_t *at = data; /* any address: this processor reads words at all of them */
    const uint8_t *const fours = at + (bytes & ~(size_t)15U);
    const uint8_t *const tail = at + (bytes & ~(size_t)3U);
    if (at != fours) { /* four words in 20 cycles; the unit needs 16 */
        __asm volatile(".p2align 3 \n"
                       "1: ldr r5, [%0, #4] \n ldr r6, [%0, #8] \n ldr r8, [%0, #12] \n ldr r4, [%0], #16 \n"
                       "rbit r4, r4 \n str r4, [%1] \n"
                       "rbit r5, r5 \n str r5, [%1] \n"
                       "rbit r6, r6 \n str r6, [%1] \n"
                       "rbit r8, r8 \n str r8, [%1] \n"
                       "cmp %0, %2 \n"
                       "bne 1b"
                       : "+r"(at)
                       : "r"(&CRC_DR), "r"(fours)
                       : "r4", "r5", "r6", "r8", "cc", "memory");
    }
    uint32_t word;
    if (at != tail) { /* 8 cycles a word, in two lines of flash; the unit needs 4 */
        __asm volatile(".p2align 3 \n 1: ldr %0, [%1], #4 \n"
                       "rbit %0, %0 \n"
                       "str %0, [%2] \n"
                       "cmp %1, %3 \n"
                       "bne 1b"
                       : "=&r"(word), "+r"(at)
                       : "r"(&CRC_DR), "r"(tail)
                       : "cc", "memory");
    }
    uint32_t crc;
    __asm volatile("rbit %0, %1" : "=r"(crc) : "r"(CRC_DR));
    for (size_t left = bytes % 4U; left > 0U; left--) { /* the unit takes words only */
        crc ^= *at++;
        for (uint32_t bit = 0U; bit < 8U; bit++) {
            crc = (crc >> 1) ^ (REFLECTED & (0U - (crc & 1U)));
        }
    }
    return ~crc;
}
