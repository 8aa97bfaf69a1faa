/* ADXL345 accelerometer (Analog Devices data sheet, rev. E): full resolution, +-16 g, 256 counts per g. Timed
 * reads take the newest sample; its age is at most one period of its output rate. */
#include "imu_chip.h"

static const chip_step_t steps[] = {
    {CHIP_CHECK, 0x00U, 0xffU, 0xe5U},  /* DEVID */
    {CHIP_WRITE, 0x2dU, 0U, 0x00U},     /* POWER_CTL: standby while it is set up */
    {CHIP_OPTION, 0x2cU, 0x1fU, 0x00U}, /* BW_RATE: output rate, no low power */
    {CHIP_WRITE, 0x31U, 0U, 0x0bU},     /* DATA_FORMAT: FULL_RES, +-16 g, four wires */
    {CHIP_WRITE, 0x38U, 0xc0U, 0x00U},  /* FIFO_CTL: bypass, only the newest sample */
    {CHIP_CHECK, 0x31U, 0xffU, 0x0bU},  /* SPI acknowledges nothing: see that it was heard */
    {CHIP_WRITE, 0x2dU, 0x0cU, 0x08U},  /* POWER_CTL: measure, awake */
    {CHIP_AWAIT, 0x30U, 0x80U, 0x80U},  /* INT_SOURCE: DATA_READY */
};

/* Least noise at rest: 0.75, 0.75, 1.1 counts rms at 100 samples/s (data sheet, table 1), less by the square
 * root of the rate below that. Tests compute the numbers. */
static const imu_still_t still[] = {
    {160U, 221U, 2590U}, {80U, 57U, 337U}, {40U, 24U, 105U}, {20U, 13U, 51U}, /* 6.25 to 50 Hz */
    {10U, 8U, 32U},                                                           /* 100 Hz and more */
};

const chip_t adxl345 = {
    .steps = steps,
    .still = {[ACCEL] = still},
    .option_first = 6U,
    .still_last = 4U,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x53U, /* SDO/ALT ADDRESS low */
    .data = 0x32U,    /* DATAX0 to DATAZ1 */
    .data_bytes = 6U,
    .rail = 4094, /* 16 g; from 1600 Hz on the last bit is 0 */
    .low_byte_first = true,
};
