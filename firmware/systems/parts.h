/* How the C files of one system, NAME.c and NAME_*.c, call each other. systems.cmake compiles them as one
 * unit, with PLUMB_ONE_UNIT: what one part offers the others is then static, and inlined as within one file.
 * Compiled one by one they are the same program, with more calls. */
#ifndef PLUMB_SYSTEMS_PARTS_H
#define PLUMB_SYSTEMS_PARTS_H

#include "core/fixed.h"

/* PART_KERNEL: small, or called in one place of every step. */
#if defined(PLUMB_ONE_UNIT)
#define PART        static
#define PART_KERNEL KERNEL
#else
#define PART
#define PART_KERNEL
#endif

#endif
