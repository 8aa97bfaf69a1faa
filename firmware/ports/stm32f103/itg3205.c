/* ITG-3205 gyro (InvenSense data sheet PS-ITG-3205A): +-2000 deg/s, 14.375 counts per deg/s, 1000 samples a
 * second behind its low-pass. Timed reads take the newest sample, at most 1 ms old. */
#include "imu_chip.h"

static const chip_step_t steps[] = {
    {CHIP_CHECK, 0x00U, 0x7eU, 0x68U},  /* WHO_AM_I: bits 6 to 1 alone are defined */
    {CHIP_WRITE, 0x3eU, 0x7fU, 0x01U},  /* PWR_MGM: awake, clock from the x gyro */
    {CHIP_WRITE, 0x15U, 0xffU, 0x00U},  /* SMPLRT_DIV: every sample of the 1 kHz */
    {CHIP_OPTION, 0x16U, 0x1fU, 0x18U}, /* DLPF_FS: +-2000 deg/s, low-pass */
    {CHIP_WRITE, 0x17U, 0U, 0x01U},     /* INT_CFG: RAW_RDY_EN */
    {CHIP_AWAIT, 0x1aU, 0x01U, 0x01U},  /* INT_STATUS: RAW_DATA_RDY */
};

/* Least noise at rest: 0.38 deg/s rms, 5.5 counts, behind 98 Hz (data sheet, section 3.1), less by the square
 * root of the bandwidth; readings count as independent at half the inverse of the bandwidth. Tests compute
 * the numbers. */
static const imu_still_t still[] = {
    {10U, 3U, 9U},  {10U, 3U, 9U},  {12U, 3U, 10U},  /* 188, 98, 42 Hz */
    {25U, 4U, 12U}, {50U, 5U, 14U}, {100U, 5U, 17U}, /* 20, 10, 5 Hz */
};

const chip_t itg3205 = {
    .steps = steps,
    .still = {[GYRO] = still},
    .option_first = 1U,
    .still_last = 5U,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x68U, /* AD0 low */
    .data = 0x1dU,    /* GYRO_XOUT_H to GYRO_ZOUT_L */
    .data_bytes = 6U,
    .rail = INT16_MAX,
    .low_byte_first = false,
};
