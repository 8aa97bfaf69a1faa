/* Gyro and accelerometer on I2C and SPI: how a chip is described (adxl345.c, itg3205.c, mpu6050.c), and the
 * functions of imu.c. */
#ifndef PLUMB_STM32F103_IMU_H
#define PLUMB_STM32F103_IMU_H

#include "app/board_sensors.h"
#include "i2c.h"

typedef enum {
    CHIP_CHECK, /* the register, masked, must hold the value */
    CHIP_KNOWN, /* the register must hold one of the chip's identities */
    CHIP_WRITE,
    CHIP_OPTION, /* write the value with the sensor's option (output rate, filter) or-ed in */
    CHIP_AWAIT   /* like CHECK, for up to 200 ms */
} chip_action_t;

/* One register access of a chip's set-up; the first one checks its identity. */
typedef struct {
    uint8_t action; /* chip_action_t */
    uint8_t reg;
    uint8_t mask;
    uint8_t value;
} chip_step_t;

/* A chip is stuck when it repeats a sample on all its axes `repeats` times at intervals of at least
 * interval_ms: with its noise at rest that does not happen. */
typedef struct {
    uint8_t interval_ms;
    uint8_t repeats;
} chip_stuck_t;

typedef struct {
    const chip_step_t *steps;
    const chip_stuck_t *stuck; /* one for each value of the sensor's option, from option_first on */
    const uint8_t *identities; /* of a chip that has several */
    uint8_t identity_count;
    uint8_t option_first;
    uint8_t step_count;
    uint8_t address;    /* on I2C */
    uint8_t data;       /* first register of a sample: x, y, z, 16 bits each */
    uint8_t data_bytes; /* of a sample: 6, or of a chip with both sensors IMU_DATA_MAX */
    uint8_t gyro_at;    /* of a chip with both sensors: place of the rates, behind the accelerations */
    bool low_byte_first;
} chip_t;

#define IMU_DATA_MAX 14u

extern const chip_t adxl345, itg3205, mpu6050;

/* Choose the sensors; with interrupts masked. */
void imu_use(const board_sensors_t *wanted);

/* Fills gyro, accel and bus_failures. */
void imu_health(board_health_t *health);

/* Called by interrupts of one priority: when a period of length_us begins, every millisecond, and when an
 * access has ended. */
void imu_period(uint32_t length_us);
void imu_poll_ms(void);
void imu_transferred(transfer_t result);

#endif
