#include "semihosting.h"
#include <string.h>

enum { SYS_OPEN = 0x01, SYS_CLOSE = 0x02, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { OPEN_READ_BINARY = 1, OPEN_WRITE_BINARY = 5 };
#define ADP_STOPPED_APPLICATION_EXIT 0x20026U

static uint32_t call(uint32_t operation, const uint32_t *block) {
    register uint32_t r0 __asm__("r0") = operation;
    register const uint32_t *r1 __asm__("r1") = block;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

int32_t semihosting_open(const char *name, bool for_writing) {
    const uint32_t block[3] = {(uint32_t)name, for_writing ? OPEN_WRITE_BINARY : OPEN_READ_BINARY,
                               (uint32_t)strlen(name)};
    return (int32_t)call(SYS_OPEN, block);
}

void semihosting_close(int32_t handle) {
    const uint32_t block[1] = {(uint32_t)handle};
    (void)call(SYS_CLOSE, block);
}

bool semihosting_read(int32_t handle, void *data, size_t bytes) {
    const uint32_t block[3] = {(uint32_t)handle, (uint32_t)data, bytes};
    return call(SYS_READ, block) == 0; /* both answer the number of bytes left over */
}

bool semihosting_write(int32_t handle, const void *data, size_t bytes) {
    const uint32_t block[3] = {(uint32_t)handle, (uint32_t)data, bytes};
    return call(SYS_WRITE, block) == 0;
}

void semihosting_exit(uint32_t code) {
    const uint32_t block[2] = {ADP_STOPPED_APPLICATION_EXIT, code};
    for (;;) {
        (void)call(SYS_EXIT_EXTENDED, block);
    }
}
