/* The two digital sensors: what their chips' files say about them, and what the port asks of imu.c. */
#ifndef PLUMB_STM32F103_IMU_H
#define PLUMB_STM32F103_IMU_H

#include "port.h"

typedef enum {
    CHIP_CHECK, /* the register, masked, must hold the value */
    CHIP_WRITE,
    CHIP_OPTION, /* write the value with the sensor's option (output rate, filter) or-ed in */
    CHIP_AWAIT   /* like CHECK, for up to 200 ms */
} chip_action_t;

/* One register access of a chip's start, of which the identity is the first. */
typedef struct {
    uint8_t action; /* chip_action_t */
    uint8_t reg;
    uint8_t mask;
    uint8_t value;
} chip_step_t;

typedef struct {
    const chip_step_t *steps;
    uint8_t step_count;
    uint8_t address; /* on I2C */
    uint8_t data;    /* first of six registers: x, y, z, 16 bits each */
    bool low_byte_first;
} chip_t;

extern const chip_t adxl345, itg3205;

#endif
