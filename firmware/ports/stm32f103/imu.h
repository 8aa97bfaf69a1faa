/* Gyro and accelerometer on I2C and SPI: the functions of imu.c, and those of imu_bus.c for their buses. An
 * image without digital sensors has neither. */
#ifndef PLUMB_STM32F103_IMU_H
#define PLUMB_STM32F103_IMU_H

#include "app/board_sensors.h"
#include "generated/used_parts.h"
#include "i2c.h"
#include "imu_chip.h"

/* Called by interrupts of one priority when an access has ended. */
void imu_transferred(transfer_t result);

#if USED_DIGITAL
/* Start the buses. After clock_init(). */
void imu_init(void);

/* Choose the sensors; with interrupts masked. */
void imu_use(const board_sensors_t *wanted);

/* Fills gyro, accel and bus_failures. */
void imu_health(board_health_t *health);

/* Called by interrupts of the same priority: when a period of length_us begins, and every millisecond. */
void imu_period(uint32_t length_us);
void imu_poll_ms(void);

void spi_dma_handler(void);
void i2c_event_handler(void);
void i2c_error_handler(void);
void i2c_dma_handler(void);
#else
static inline void imu_init(void) {}
static inline void imu_use(const board_sensors_t *wanted) {
    (void)wanted;
}
static inline void imu_health(board_health_t *health) {
    health->gyro = health->accel = BOARD_SENSOR_GOOD;
    health->bus_failures = 0U;
}
static inline void imu_period(uint32_t length_us) {
    (void)length_us;
}
static inline void imu_poll_ms(void) {}
static inline void spi_dma_handler(void) {}
static inline void i2c_event_handler(void) {}
static inline void i2c_error_handler(void) {}
static inline void i2c_dma_handler(void) {}
#endif

#endif
