/* The body of plumb/calibration.h, inlined into the steps: the manual is there. The product of gain and count
 * alone may overflow: the sum is taken modulo 2^32. */
#ifndef PLUMB_CORE_CALIBRATION_H
#define PLUMB_CORE_CALIBRATION_H

#include "fixed.h"
#include "plumb/calibration.h"

/* About 5 cycles. */
static inline int32_t calibration_clamp(const plumb_calibration_params_t *p, int32_t raw) {
    return clamp_i32(raw, p->raw_min, p->raw_max);
}

/* Clamped counts in the unit of the calibration. About 4 cycles. */
static inline int32_t calibration_scale(const plumb_calibration_params_t *p, int32_t raw) {
    return wrap_i32((uint32_t)raw * (uint32_t)p->gain + (uint32_t)p->offset);
}

/* Clamp and scale; sets `flag` in *flags when the count was outside its range. */
KERNEL int32_t calibration_apply(const plumb_calibration_params_t *p, int32_t raw, uint32_t *flags,
                                 uint32_t flag) {
    int32_t low = p->raw_min, high = p->raw_max;
    uint32_t gain = (uint32_t)p->gain, offset = (uint32_t)p->offset;
    LOADED4(low, high, gain, offset);
#if defined(__GNUC__) && defined(__thumb2__) /* as below, clamp and flag under one condition */
    __asm__("cmp %0, %2 \n itt lt \n movlt %0, %2 \n orrlt %1, %1, %4 \n"
            "cmp %0, %3 \n itt gt \n movgt %0, %3 \n orrgt %1, %1, %4"
            : "+r"(raw), "+r"(*flags)
            : "r"(low), "r"(high), "rI"(flag)
            : "cc");
#else
    const int32_t used = clamp_i32(raw, low, high);
    *flags |= used != raw ? flag : 0U;
    raw = used;
#endif
    return wrap_i32((uint32_t)raw * gain + offset);
}

#endif
