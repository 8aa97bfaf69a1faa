/* ITG-3205 gyro (InvenSense data sheet PS-ITG-3205A): +-2000 deg/s, 14.375 counts per deg/s, 1000 samples a
 * second behind its low-pass. Timed reads take the newest sample, at most 1 ms old. */
#include "imu.h"

static const chip_step_t steps[] = {
    {CHIP_CHECK, 0x00u, 0x7eu, 0x68u}, /* WHO_AM_I: bits 6 to 1 alone are defined */
    {CHIP_WRITE, 0x3eu, 0u, 0x01u},    /* PWR_MGM: awake, clock from the x gyro */
    {CHIP_WRITE, 0x15u, 0u, 0x00u},    /* SMPLRT_DIV: every sample of the 1 kHz */
    {CHIP_OPTION, 0x16u, 0u, 0x18u},   /* DLPF_FS: +-2000 deg/s, low-pass */
    {CHIP_WRITE, 0x17u, 0u, 0x01u},    /* INT_CFG: RAW_RDY_EN */
    {CHIP_AWAIT, 0x1au, 0x01u, 0x01u}, /* INT_STATUS: RAW_DATA_RDY */
};

const chip_t itg3205 = {
    .steps = steps,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x68u, /* AD0 low */
    .data = 0x1du,    /* GYRO_XOUT_H to GYRO_ZOUT_L */
    .low_byte_first = false,
};
