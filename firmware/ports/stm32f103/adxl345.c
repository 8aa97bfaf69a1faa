/* ADXL345 accelerometer (Analog Devices data sheet, rev. E): full resolution, +-16 g, 256 counts per g. Timed
 * reads take the newest sample; its age is at most one period of its output rate. */
#include "imu_chip.h"

static const chip_step_t steps[] = {
    {CHIP_CHECK, 0x00u, 0xffu, 0xe5u},  /* DEVID */
    {CHIP_WRITE, 0x2du, 0u, 0x00u},     /* POWER_CTL: standby while it is set up */
    {CHIP_OPTION, 0x2cu, 0x1fu, 0x00u}, /* BW_RATE: output rate, no low power */
    {CHIP_WRITE, 0x31u, 0u, 0x0bu},     /* DATA_FORMAT: FULL_RES, +-16 g, four wires */
    {CHIP_WRITE, 0x38u, 0xc0u, 0x00u},  /* FIFO_CTL: bypass, only the newest sample */
    {CHIP_CHECK, 0x31u, 0xffu, 0x0bu},  /* SPI acknowledges nothing: see that it was heard */
    {CHIP_WRITE, 0x2du, 0x0cu, 0x08u},  /* POWER_CTL: measure, awake */
    {CHIP_AWAIT, 0x30u, 0x80u, 0x80u},  /* INT_SOURCE: DATA_READY */
};

/* Least noise at rest: 0.75, 0.75, 1.1 counts rms at 100 samples/s (data sheet, table 1), less by the square
 * root of the rate below that. Tests compute the numbers. */
static const imu_still_t still[] = {
    {160u, 221u, 2590u}, {80u, 57u, 337u}, {40u, 24u, 105u}, {20u, 13u, 51u}, /* 6.25 to 50 Hz */
    {10u, 8u, 32u},                                                           /* 100 Hz and more */
};

const chip_t adxl345 = {
    .steps = steps,
    .still = {[ACCEL] = still},
    .option_first = 6u,
    .still_last = 4u,
    .step_count = sizeof steps / sizeof steps[0],
    .address = 0x53u, /* SDO/ALT ADDRESS low */
    .data = 0x32u,    /* DATAX0 to DATAZ1 */
    .data_bytes = 6u,
    .rail = 4094, /* 16 g; from 1600 Hz on the last bit is 0 */
    .low_byte_first = true,
};
