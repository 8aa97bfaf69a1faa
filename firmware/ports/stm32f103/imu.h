/* Gyro and accelerometer on I2C and SPI: the functions of imu.c. */
#ifndef PLUMB_STM32F103_IMU_H
#define PLUMB_STM32F103_IMU_H

#include "app/board_sensors.h"
#include "i2c.h"
#include "imu_chip.h"

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
