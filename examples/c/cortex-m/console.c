#include "console.h"

enum { SYS_WRITE0 = 0x04, SYS_EXIT_EXTENDED = 0x20 };
#define STOPPED_APPLICATION_EXIT 0x20026U

static void call(uint32_t operation, const void *argument) {
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void console_text(const char *text) {
    call(SYS_WRITE0, text);
}

void console_number(int32_t x) {
    char digits[12], *at = digits + sizeof digits - 1;
    uint32_t rest = x < 0 ? 0U - (uint32_t)x : (uint32_t)x;
    *at = '\0';
    do {
        *--at = (char)('0' + rest % 10U);
        rest /= 10U;
    } while (rest != 0U);
    if (x < 0) {
        *--at = '-';
    }
    console_text(at);
}

void console_exit(int code) {
    const uint32_t block[2] = {STOPPED_APPLICATION_EXIT, (uint32_t)code};
    for (;;) {
        call(SYS_EXIT_EXTENDED, block);
    }
}
