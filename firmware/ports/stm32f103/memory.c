/* memcpy, memset and memcmp, which the compiler may call on its own: a word at a time, then a byte at a time,
 * in a fifth of the C library's size. */
#include <stdint.h>
#include <string.h>

/* Four bytes at any address: this processor accesses unaligned words. */
typedef uint32_t __attribute__((may_alias, aligned(1))) word_t;

void *memcpy(void *restrict to, const void *restrict from, size_t count) {
    uint8_t *target = to;
    const uint8_t *source = from;
    for (; count >= 4U; count -= 4U, target += 4, source += 4) {
        *(word_t *)target = *(const word_t *)source;
    }
    for (; count > 0U; count--) {
        *target++ = *source++;
    }
    return to;
}

void *memset(void *to, int value, size_t count) {
    uint8_t *target = to;
    const uint32_t four = (uint8_t)value * 0x01010101U;
    for (; count >= 4U; count -= 4U, target += 4) {
        *(word_t *)target = four;
    }
    for (; count > 0U; count--) {
        *target++ = (uint8_t)value;
    }
    return to;
}

int memcmp(const void *left, const void *right, size_t count) {
    const uint8_t *a = left, *b = right;
    for (; count >= 4U && *(const word_t *)a == *(const word_t *)b; count -= 4U, a += 4, b += 4)
        ;
    for (; count > 0U && *a == *b; count--, a++, b++)
        ;
    return count > 0U ? *a - *b : 0;
}
