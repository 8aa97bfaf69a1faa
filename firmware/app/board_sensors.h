/* The board's own sensors: which are sampled, how often, and whether they are to be trusted. */
#ifndef PLUMB_BOARD_SENSORS_H
#define PLUMB_BOARD_SENSORS_H

#include <stdbool.h>
#include <stdint.h>

#define BOARD_RAW_MAX 6u /* raw counts of one sample; a system uses the first few */

/* Which sensors a tick samples. */
typedef enum {
    BOARD_SENSORS_NONE = 0, /* ticks alone: samples come from the host */
    BOARD_SENSORS_ANALOG_3, /* PA0 to PA2 */
    BOARD_SENSORS_ANALOG_6, /* PA0 to PA3, PB0, PB1; INT16_MIN where an input is at a rail or hangs */
    BOARD_SENSORS_BALANCE   /* angular rate and two accelerations of the digital sensors */
} board_sensor_kind_t;

typedef struct {
    uint32_t kind;            /* board_sensor_kind_t */
    uint32_t oversample_log2; /* 0 to 4: scans of the analog inputs per period */
    uint32_t rail_ms;         /* time at a rail, at least 3 conversions, that makes a fault; 0: never */
    uint32_t stuck_ms;     /* time without any change, at least 3 conversions; digital sensors have limits of
                              their own, as their noise allows; 0: never, for these too */
    uint32_t accel_on_spi; /* 0: the accelerometer is on I2C */
    uint32_t accel_rate;   /* ADXL345 BW_RATE: 0 to 15 */
    uint32_t gyro_filter;  /* ITG-3205 DLPF_CFG: 0 to 6 */
    uint32_t imu_axis;     /* of the wheels: 0 x, 1 y, 2 z */
} board_sensors_t;

/* Why a digital sensor is not to be trusted. */
typedef enum {
    BOARD_SENSOR_GOOD = 0,  /* or not in use */
    BOARD_SENSOR_STARTING,  /* not found yet */
    BOARD_SENSOR_NO_ANSWER, /* nobody answers where it should be */
    BOARD_SENSOR_BUS,       /* the bus hangs, or an access took too long */
    BOARD_SENSOR_IDENTITY,  /* another chip answers, or it did not take its settings */
    BOARD_SENSOR_SILENT,    /* it has no data */
    BOARD_SENSOR_STUCK      /* its data do not change */
} board_sensor_cause_t;

typedef struct {
    uint16_t railed;       /* one bit an analog input */
    uint16_t stuck;        /* one bit an analog input */
    uint8_t gyro;          /* board_sensor_cause_t */
    uint8_t accel;         /* board_sensor_cause_t */
    uint16_t bus_failures; /* accesses of digital sensors that failed, modulo 2^16 */
} board_health_t;

/* One period of six inputs converted once; twice that for every step of oversample_log2. */
#define BOARD_SCAN_US 50u

/* Choose the sensors. Digital ones are found, set up and watched from here on, whether a period runs or not;
 * they need some 20 ms. The same again changes nothing. */
void board_use_sensors(const board_sensors_t *wanted);

void board_sensor_health(board_health_t *health);

/* Start the control period, 50 us to 131072 us (an odd number above 65536 us is rounded down): the sensors
 * are sampled by hardware and one tick per period follows, the first after a period. 0 stops it. The same
 * value again changes nothing. */
void board_set_period_us(uint32_t period_us);

/* True once per control period, when that period's sensors are ready; while one of them gives nothing, never.
 */
bool board_take_tick(void);

/* Raw counts of the last tick, 0 for places the sensors do not fill. */
void board_read_sensors(int16_t raw[BOARD_RAW_MAX]);

#endif
