/* The board's own sensors: which are sampled, how often, and whether they can be trusted. */
#ifndef PLUMB_BOARD_SENSORS_H
#define PLUMB_BOARD_SENSORS_H

#include "generated/used_parts.h" /* BOARD_RAW_MAX */
#include <stdbool.h>
#include <stdint.h>

/* Which sensors a tick samples. */
typedef enum {
    BOARD_SENSORS_NONE = 0, /* ticks alone: samples come from the host */
    BOARD_SENSORS_ANALOG_3, /* PA0 to PA2 */
    BOARD_SENSORS_ANALOG_6, /* PA0 to PA3, PB0, PB1; INT16_MIN for an input at a rail or stuck */
    BOARD_SENSORS_BALANCE,  /* angular rate and two accelerations of the digital sensors */
    BOARD_SENSORS_SIX_AXES, /* angular rates x, y, z and accelerations x, y, z of the digital sensors */
    BOARD_SENSORS_RIDE      /* angular rate y, accelerations x and z, angular rate z; encoders left and right,
                               rider */
} board_sensor_kind_t;

typedef struct {
    uint32_t kind;            /* board_sensor_kind_t */
    uint32_t oversample_log2; /* 0 to 4: scans of the analog inputs per period */
    uint32_t rail_ms;     /* an input at a rail for this long, at least 3 conversions, is a fault; 0: never */
    uint32_t stuck_ms;    /* an input unchanged for this long, at least 3 conversions, is a fault; 0: never.
                             Digital sensors have limits of their own (from their noise), unless this is 0 */
    uint32_t accel_bus;   /* which chips are wired, and to which bus: the parameter of this name */
    uint32_t accel_rate;  /* option of an accelerometer with a chip of its own, ADXL345 BW_RATE: 0 to 15 */
    uint32_t gyro_filter; /* option of a gyro, or of both sensors of one chip, DLPF_CFG: 0 to 6 */
    uint32_t imu_axis;    /* of the wheels: 0 x, 1 y, 2 z */
    uint32_t marks_missing; /* 1: ticks go on when six axes are lost, with counts of INT16_MIN */
} board_sensors_t;

/* Why a digital sensor cannot be trusted. */
typedef enum {
    BOARD_SENSOR_GOOD = 0,  /* or not in use */
    BOARD_SENSOR_STARTING,  /* not found yet */
    BOARD_SENSOR_NO_ANSWER, /* no chip answers at its address */
    BOARD_SENSOR_BUS,       /* the bus hangs, or an access took too long */
    BOARD_SENSOR_IDENTITY,  /* another chip answers, or its settings do not read back */
    BOARD_SENSOR_SILENT,    /* it has no data */
    BOARD_SENSOR_STUCK,     /* its data do not change, on one axis or on all */
    BOARD_SENSOR_RAIL       /* an axis is at its limit, for 20 ms or again and again */
} board_sensor_cause_t;

typedef struct {
    uint16_t railed;       /* one bit for each analog input */
    uint16_t stuck;        /* one bit for each analog input */
    uint8_t gyro;          /* board_sensor_cause_t */
    uint8_t accel;         /* board_sensor_cause_t */
    uint16_t bus_failures; /* accesses of digital sensors that failed, modulo 2^16 */
} board_health_t;

/* Shortest period with analog sensors: one scan of six inputs. Doubles with each step of oversample_log2. */
#define BOARD_SCAN_US 50U

/* Choose the sensors. From then on the board finds, sets up and monitors the digital ones, whether a period
 * runs or not; that takes about 20 ms. Choosing the same sensors again changes nothing. */
void board_use_sensors(const board_sensors_t *wanted);

void board_sensor_health(board_health_t *health);

/* Start the control period, 50 us to 131072 us (an odd number above 65536 us is rounded down): hardware
 * starts each sample, and each complete sample is one tick; the first comes after one period. 0 stops the
 * period. The same value again changes nothing. */
void board_set_period_us(uint32_t period_us);

/* True when board_take_tick() would be. */
bool board_tick_waits(void);

/* True once per control period, when that period's sample is complete. Without data from all sensors in use
 * there is no tick, unless marks_missing and there was one before. */
bool board_take_tick(void);

/* Raw counts of the last tick; 0 for channels that the sensors do not fill. */
void board_read_sensors(int16_t raw[BOARD_RAW_MAX]);

#endif
