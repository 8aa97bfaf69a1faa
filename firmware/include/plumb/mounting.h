/* How a sensor of three axes is mounted: its axes and signs, the angles by which it is off, and the errors of
 * its own axes (scale and misalignment), as one 3x3 matrix from sensor axes to the body's.
 *
 * Q30: 2^30 is 1. The identity leaves every value as it is, to the bit. A matrix of 0 and +-2^30 with one
 * entry in every row and column maps axes without any rounding. */
#ifndef PLUMB_MOUNTING_H
#define PLUMB_MOUNTING_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLUMB_MOUNTING_ONE (1L << 30)

/* Rows of the matrix, Q30: body x from sensor x, y, z, and so on. */
typedef struct {
    int32_t xx_q30, xy_q30, xz_q30;
    int32_t yx_q30, yy_q30, yz_q30;
    int32_t zx_q30, zy_q30, zz_q30;
} plumb_mounting_params_t;

/* Replaces a vector in sensor axes by the one in the body's: each component is the sum of three products,
 * rounded to nearest, and limited to +-PLUMB_CALIBRATION_LIMIT. v: three calibrated values, each within that
 * limit. False when a component was limited. About 70 cycles on a Cortex-M3. */
bool plumb_mounting_apply(const plumb_mounting_params_t *p, int32_t v[3]);

/* False if the absolute values of a row sum to 2 or more, or if the determinant is not between 1/2 and 2:
 * such a matrix mounts no sensor. That of a mirrored one, left-handed, is negative. */
bool plumb_mounting_valid(const plumb_mounting_params_t *p);

#ifdef __cplusplus
}
#endif

#endif
