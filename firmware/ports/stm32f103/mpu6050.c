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

#define WHO_AM_I 0x75u

static const uint8_t identities[] = {
    0x68u, /* MPU-6050, MPU-6000 */
    0x70u, /* MPU-6500 */
    0x72u, /* an MPU-6500 of unknown make */
    0x98u, /* ICM-20689 */
};

static const chip_step_t steps[] = {
    {CHIP_KNOWN, WHO_AM_I, 0u, 0u},
    {CHIP_WRITE, 0x6bu, 0x6fu, 0x01u},  /* PWR_MGMT_1: awake, clock from the x gyro */
    {CHIP_WRITE, 0x6cu, 0x3fu, 0x00u},  /* PWR_MGMT_2: no axis in standby */
    {CHIP_WRITE, 0x19u, 0xffu, 0x00u},  /* SMPLRT_DIV: every sample of the 1 kHz */
    {CHIP_OPTION, 0x1au, 0x07u, 0x00u}, /* CONFIG: low-pass */
    {CHIP_WRITE, 0x1bu, 0u, 0x18u},     /* GYRO_CONFIG: +-2000 deg/s */
    {CHIP_WRITE, 0x1cu, 0u, 0x18u},     /* ACCEL_CONFIG: +-16 g */
    {CHIP_CHECK, 0x1bu, 0xf8u, 0x18u},  /* no self-test, and the range: a wrong one reads a wrong angle */
    {CHIP_CHECK, 0x1cu, 0xf8u, 0x18u},
    {CHIP_WRITE, 0x38u, 0u, 0x01u},    /* INT_ENABLE: DATA_RDY_EN */
    {CHIP_AWAIT, 0x3au, 0x01u, 0x01u}, /* INT_STATUS: DATA_RDY_INT */
};

/* Least noise at rest: gyro 0.05 deg/s rms, 0.82 counts, behind 98 Hz, accelerometer 400 ug/sqrt(Hz) (data
 * sheet PS-MPU-6000A-00, rev. 3.4, tables 6.1 and 6.2), less by the square root of the bandwidth; readings
 * count as independent at half the inverse of the bandwidth. Tests compute the numbers. */
static const imu_still_t rates[] = {
    {10u, 9u, 29u},   {10u, 9u, 29u},    {12u, 16u, 52u},     /* 188, 98, 42 Hz */
    {25u, 36u, 113u}, {50u, 117u, 371u}, {100u, 942u, 2984u}, /* 20, 10, 5 Hz */
};

static const imu_still_t forces[] = {
    {10u, 3u, 8u},  {10u, 3u, 8u},  {12u, 3u, 9u},   /* 188, 98, 42 Hz */
    {25u, 3u, 10u}, {50u, 4u, 11u}, {100u, 4u, 13u}, /* 20, 10, 5 Hz */
};

const chip_t mpu6050 = {
    .steps = steps,
    .still = {rates, forces},
    .identities = identities,
    .identity_count = sizeof identities,
    .option_first = 1u,
    .still_last = 5u,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x68u, /* AD0 low */
    .data = 0x3bu,    /* ACCEL_XOUT_H to GYRO_ZOUT_L */
    .data_bytes = 14u,
    .gyro_at = 8u, /* behind the accelerations and the temperature */
    .rail = INT16_MAX,
    .low_byte_first = false,
};
