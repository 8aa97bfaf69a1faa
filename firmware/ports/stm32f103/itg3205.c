/* ITG-3205 gyro (InvenSense data sheet PS-ITG-3205A): +-2000 deg/s, 14.375 counts per deg/s, 1000 samples a
 * second behind its low-pass. Timed reads take the newest sample, at most 1 ms old. */
#include "imu_chip.h"

static const chip_step_t steps[] = {
    {CHIP_CHECK, 0x00u, 0x7eu, 0x68u},  /* WHO_AM_I: bits 6 to 1 alone are defined */
    {CHIP_WRITE, 0x3eu, 0x7fu, 0x01u},  /* PWR_MGM: awake, clock from the x gyro */
    {CHIP_WRITE, 0x15u, 0xffu, 0x00u},  /* SMPLRT_DIV: every sample of the 1 kHz */
    {CHIP_OPTION, 0x16u, 0x1fu, 0x18u}, /* DLPF_FS: +-2000 deg/s, low-pass */
    {CHIP_WRITE, 0x17u, 0u, 0x01u},     /* INT_CFG: RAW_RDY_EN */
    {CHIP_AWAIT, 0x1au, 0x01u, 0x01u},  /* INT_STATUS: RAW_DATA_RDY */
};

/* Least noise at rest: 0.38 deg/s rms, 5.5 counts, behind 98 Hz (data sheet, section 3.1), less by the square
 * root of the bandwidth; readings count as independent at half the inverse of the bandwidth. Tests compute
 * the numbers. */
static const imu_still_t still[] = {
    {10u, 3u, 9u},  {10u, 3u, 9u},  {12u, 3u, 10u},  /* 188, 98, 42 Hz */
    {25u, 4u, 12u}, {50u, 5u, 14u}, {100u, 5u, 17u}, /* 20, 10, 5 Hz */
};

const chip_t itg3205 = {
    .steps = steps,
    .still = {[GYRO] = still},
    .option_first = 1u,
    .still_last = 5u,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x68u, /* AD0 low */
    .data = 0x1du,    /* GYRO_XOUT_H to GYRO_ZOUT_L */
    .data_bytes = 6u,
    .rail = INT16_MAX,
    .low_byte_first = false,
};
