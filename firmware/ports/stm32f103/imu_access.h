/* Accesses of the chips with gyro and accelerometer, one at a time: on the bus of each, for what its
 * declaration says. */
#ifndef PLUMB_STM32F103_IMU_ACCESS_H
#define PLUMB_STM32F103_IMU_ACCESS_H

#include "app/board_sensors.h"
#include "imu_chip.h"

/* Choose the chips and their options, while no access is under way. */
void imu_access_use(const board_sensors_t *wanted);

/* The chip of a sensor: the same one twice where it has both. */
const chip_t *imu_chip(uint32_t sensor);

/* Sensors with a chip of their own: one chip with both is treated as the gyro. */
uint32_t imu_chip_count(void);

bool imu_on_spi(uint32_t sensor);

/* Limits of a sensor that stands still, with its option. */
const imu_still_t *imu_still_of(uint32_t sensor);

/* Start to read a sample of the sensor's chip; to do a step of its set-up, or with writes false only to read
 * its register. The end raises an interrupt of the bus. */
void imu_access_sample(uint32_t sensor);
void imu_access_step(uint32_t sensor, uint32_t step, bool writes);

/* After a step: true when the byte that was read is the one that the step expects; also when it wrote. */
bool imu_access_as_wanted(uint32_t sensor, uint32_t step);

/* The step behind this one that holds a setting which is read again in turn. The settings lie between the
 * identity, the first step, and the first sample, the last one. */
uint8_t imu_access_next_setting(uint32_t sensor, uint8_t step);

/* True when every byte that was read is 0xff on SPI, which has no acknowledge: the pull-up does that when the
 * chip is absent. */
bool imu_access_line_idle(uint32_t sensor);

/* After a sample: take the counts of the sensors that the chip has. Returns these, bit 0 is the gyro. */
uint32_t imu_access_take(uint32_t sensor);

#endif
