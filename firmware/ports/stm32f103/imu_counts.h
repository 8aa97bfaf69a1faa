/* Counts of gyro and accelerometer: their axes, the checks of them, and the sample of the board that they
 * make. For interrupts of one priority. */
#ifndef PLUMB_STM32F103_IMU_COUNTS_H
#define PLUMB_STM32F103_IMU_COUNTS_H

#include "app/board_sensors.h"
#include "imu_chip.h"

/* Forget every check. */
void imu_counts_clear(void);

/* Take the counts of a sensor from the bytes of its data registers. */
void imu_counts_take(uint32_t sensor, const chip_t *chip, const uint8_t *data);

/* Check the counts that were taken last, of those axes that the sample has; once for each of them. still: the
 * limits of the sensor for the option in use; beside: those of the accelerometer in the same chip, for which
 * it is enough that both stand still; NULL without one. sample_us: since the sample before. Returns
 * BOARD_SENSOR_RAIL or _STUCK when the counts are not to be trusted, else _GOOD. */
uint8_t imu_counts_judge(uint32_t sensor, const board_sensors_t *use, const imu_still_t *still,
                         const imu_still_t *beside, uint32_t sample_us);

/* Publish a sample of the kind in use. no_rate, no_force: six axes say that these are missing. */
void imu_counts_publish(const board_sensors_t *use, bool no_rate, bool no_force);

#endif
