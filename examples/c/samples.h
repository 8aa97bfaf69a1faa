/* 0.4 s of an axis that turns from level to 18 degrees at 90 deg/s and stays there, every 20 ms, as a 12-bit
 * converter reads it: gyro of 1.2 deg/s per count with a bias of 5 deg/s, acceleration along y and z of 1/993
 * g per count. */
#ifndef SAMPLES_H
#define SAMPLES_H

#include <stdint.h>

#define SAMPLES 20

static const int16_t samples[SAMPLES][3] = {
    {1680, 2048, 3046}, {1680, 2052, 3040}, {1755, 2056, 3042}, {1755, 2082, 3045}, {1755, 2113, 3035},
    {1754, 2140, 3031}, {1755, 2166, 3032}, {1754, 2202, 3029}, {1755, 2234, 3024}, {1754, 2261, 3015},
    {1754, 2293, 3001}, {1755, 2329, 2993}, {1680, 2356, 2991}, {1680, 2357, 2997}, {1680, 2352, 2990},
    {1681, 2355, 2989}, {1680, 2347, 2988}, {1679, 2346, 3000}, {1681, 2354, 2990}, {1680, 2347, 2997},
};

#endif
