/* MPU-6050, gyro and accelerometer in one chip (InvenSense register map RM-MPU-6000A-00, rev. 4.2): +-2000
 * deg/s, 16.4 counts per deg/s; +-16 g, 2048 counts per g; 1000 samples a second of both behind the low-pass
 * of both. Timed reads take the newest sample, at most 1 ms old; one read of 14 registers is one sample
 * (chapter 4.17).
 *
 * Modules that are sold under this name carry other chips with the same registers, too. They differ in
 * WHO_AM_I alone, and are accepted: all of them have these ranges, gyro filters and data registers.
 * On an MPU-6500 and its kin the accelerometer's low-pass has a register of its own (ACCEL_CONFIG 2), which
 * keeps its value after reset, the widest. */
#include "imu_chip.h"

#define WHO_AM_I 0x75U

static const uint8_t identities[] = {
    0x68U, /* MPU-6050, MPU-6000 */
    0x70U, /* MPU-6500 */
    0x72U, /* an MPU-6500 of unknown make */
    0x98U, /* ICM-20689 */
};

static const chip_step_t steps[] = {
    {CHIP_KNOWN, WHO_AM_I, 0U, 0U},
    {CHIP_WRITE, 0x6bU, 0x6fU, 0x01U},  /* PWR_MGMT_1: awake, clock from the x gyro */
    {CHIP_WRITE, 0x6cU, 0x3fU, 0x00U},  /* PWR_MGMT_2: no axis in standby */
    {CHIP_WRITE, 0x19U, 0xffU, 0x00U},  /* SMPLRT_DIV: every sample of the 1 kHz */
    {CHIP_OPTION, 0x1aU, 0x07U, 0x00U}, /* CONFIG: low-pass */
    {CHIP_WRITE, 0x1bU, 0U, 0x18U},     /* GYRO_CONFIG: +-2000 deg/s */
    {CHIP_WRITE, 0x1cU, 0U, 0x18U},     /* ACCEL_CONFIG: +-16 g */
    {CHIP_CHECK, 0x1bU, 0xf8U, 0x18U},  /* no self-test, and the range: a wrong one reads a wrong angle */
    {CHIP_CHECK, 0x1cU, 0xf8U, 0x18U},
    {CHIP_WRITE, 0x38U, 0U, 0x01U},    /* INT_ENABLE: DATA_RDY_EN */
    {CHIP_AWAIT, 0x3aU, 0x01U, 0x01U}, /* INT_STATUS: DATA_RDY_INT */
};

/* Least noise at rest: gyro 0.05 deg/s rms, 0.82 counts, behind 98 Hz, accelerometer 400 ug/sqrt(Hz) (data
 * sheet PS-MPU-6000A-00, rev. 3.4, tables 6.1 and 6.2), less by the square root of the bandwidth; readings
 * count as independent at half the inverse of the bandwidth. Tests compute the numbers. */
static const imu_still_t rates[] = {
    {10U, 9U, 29U},   {10U, 9U, 29U},    {12U, 16U, 52U},     /* 188, 98, 42 Hz */
    {25U, 36U, 113U}, {50U, 117U, 371U}, {100U, 942U, 2984U}, /* 20, 10, 5 Hz */
};

static const imu_still_t forces[] = {
    {10U, 3U, 8U},  {10U, 3U, 8U},  {12U, 3U, 9U},   /* 188, 98, 42 Hz */
    {25U, 3U, 10U}, {50U, 4U, 11U}, {100U, 4U, 13U}, /* 20, 10, 5 Hz */
};

const chip_t mpu6050 = {
    .steps = steps,
    .still = {rates, forces},
    .identities = identities,
    .identity_count = sizeof identities,
    .option_first = 1U,
    .still_last = 5U,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x68U, /* AD0 low */
    .data = 0x3bU,    /* ACCEL_XOUT_H to GYRO_ZOUT_L */
    .data_bytes = 14U,
    .gyro_at = 8U, /* behind the accelerations and the temperature */
    .rail = INT16_MAX,
    .low_byte_first = false,
};
