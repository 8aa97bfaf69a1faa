/* How a chip with gyro or accelerometer is described: the generated chips.c, from host/plumb/spec/chips. */
#ifndef PLUMB_STM32F103_IMU_CHIP_H
#define PLUMB_STM32F103_IMU_CHIP_H

#include <stdbool.h>
#include <stdint.h>

#define GYRO     0U
#define ACCEL    1U
#define SENSORS  2U
#define IMU_AXES 3U /* of a sensor */

typedef enum {
    CHIP_CHECK, /* the register, masked, must hold the value */
    CHIP_KNOWN, /* the register must hold one of the chip's identities */
    CHIP_WRITE,
    CHIP_OPTION, /* write the value with the sensor's option (output rate, filter) or-ed in */
    CHIP_AWAIT   /* like CHECK, for up to 200 ms */
} chip_action_t;

/* One register access of a chip's set-up; the first one checks its identity. mask: bits that are read again
 * in turn while the chip is sampled, and must still hold the value; 0: not read again. */
typedef struct {
    uint8_t action; /* chip_action_t */
    uint8_t reg;
    uint8_t mask;
    uint8_t value;
} chip_step_t;

/* A sensor repeats its counts by its noise: readings less than interval_ms apart depend on each other. It is
 * stuck when all its axes repeat `whole` times, or one axis `axis` times while it should have moved; with the
 * least noise at rest either happens less often than every 10^4 h. */
typedef struct {
    uint16_t interval_ms;
    uint16_t whole;
    uint16_t axis;
} imu_still_t;

/* A chip. By sensor: the limits of its counts, by its option from option_first on, the last one for all
 * above, and the place of its counts x, y, z in a sample, 16 bits each. */
typedef struct {
    const chip_step_t *steps;
    const imu_still_t *still[SENSORS];
    const uint8_t *identities; /* of a chip that has several */
    uint8_t identity_count;
    uint8_t step_count;
    uint8_t still_last[SENSORS]; /* index */
    uint8_t at[SENSORS];
    uint8_t option_first;
    uint8_t address;    /* on I2C */
    uint8_t data;       /* first register of a sample */
    uint8_t data_bytes; /* of a sample, at most IMU_DATA_MAX */
    uint8_t spi_read;   /* bits of the command that reads registers on SPI */
    bool low_byte_first;
    int16_t rail; /* a count of at least this size is at the rail */
} chip_t;

/* How gyro and accelerometer are wired. One chip with both sensors is treated as the gyro. */
typedef struct {
    uint8_t chip[SENSORS]; /* in imu_chips */
    uint8_t on_spi;        /* bit 0 is the gyro */
    uint8_t spi_divider;   /* of SPI1_CR1: PCLK2 / 2^(1 + this) */
} imu_way_t;

#define IMU_DATA_MAX 14U

extern const chip_t imu_chips[];
extern const imu_way_t imu_ways[]; /* by the parameter accel_bus */

#endif
