/* Semihosting: what QEMU does for the program it runs.  Source: Arm "Semihosting for AArch32 and AArch64",
 * operation numbers and parameter blocks. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Opens a file of the host in binary mode; a negative handle means that it cannot be opened. */
int32_t semihosting_open(const char *name, bool for_writing);
void semihosting_close(int32_t handle);

/* True when every byte was transferred. */
bool semihosting_read(int32_t handle, void *data, size_t bytes);
bool semihosting_write(int32_t handle, const void *data, size_t bytes);

/* Ends QEMU with this exit code. */
void semihosting_exit(uint32_t code) __attribute__((noreturn));

#endif
