#include "tilt.h"

#define VARIANCE_MAX 0x1000000UL /* 2^24, as the filter wants it */

SELDOM_CALLED bool plumb_tilt_valid(const plumb_tilt_params_t *p) {
    if (p->mode > PLUMB_TILT_ATAN2 || p->deviation_shift > 31U ||
        p->deviation_max > UINT32_MAX >> p->deviation_shift) {
        return false;
    }
    const uint32_t d = p->deviation_max << p->deviation_shift;
    return p->r_base >= 1U && p->r_base <= p->r_max && p->r_max <= VARIANCE_MAX &&
           mulhi_u32(mulhi_u32(d, d), p->r_gain) <= UINT32_MAX - p->r_base;
}
