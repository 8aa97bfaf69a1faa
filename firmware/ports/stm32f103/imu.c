/* Gyro and accelerometer on I2C and SPI, in two chips or one: finds them, sets them up, reads both once a
 * period, and finds a lost one again.
 *
 * Everything here runs in interrupts of one priority: imu_period() once a period, imu_poll_ms() every
 * millisecond, imu_transferred() at the end of an access. One access is under way at a time; imu_poll_ms()
 * aborts one that takes longer than 2 ms. A failed access is tried three times; then the sensor is lost, the
 * bus is cleared, and the sensor is set up anew every 20 ms. Without both sensors there is no sample, and
 * so no tick; but once there was one, a system that marks what is missing gets counts of INT16_MIN for all,
 * or for the accelerations when the gyro is good. */
#include "imu.h"
#include "bridge.h"
#include "generated/used_parts.h"
#include "ride.h"
#include "samples.h"
#include "spi.h"

#define GYRO      0u
#define ACCEL     1u
#define SENSORS   2u
#define TRIES     3u
#define ACCESS_MS 2u   /* reading 14 bytes takes 0.4 ms at 400 kHz */
#define RETRY_MS  20u  /* from the loss of a sensor to the next set-up */
#define AWAIT_MS  200u /* for the first sample: the accelerometer's slowest rate is 6.25 Hz */
#define SPI_READ  0x80u
#define SPI_MANY  0x40u
#define AXIS_LAST 2u

typedef enum { OFF, RECOVER, REST, SET_UP, SAMPLE } phase_t;

typedef struct {
    uint8_t cause;      /* BOARD_SENSOR_*: why it is not trusted */
    bool up;            /* set up: it is read once a period */
    uint8_t step;       /* of its chip's set-up */
    uint8_t wait_ms;    /* until the next set-up */
    uint8_t awaited_ms; /* how long CHIP_AWAIT has waited */
    uint16_t same;      /* samples in a row that equal the one before on all axes, to the limit */
} sensor_t;

static const chip_t *const two_chips[SENSORS] = {&itg3205, &adxl345};
static board_sensors_t use;
static volatile phase_t phase;
static sensor_t sensors[SENSORS];
static uint32_t active;                  /* sensor whose access is under way */
static uint32_t asked;                   /* bytes that the access reads; 0: it writes one */
static uint32_t age_ms, tries;           /* of the access */
static uint16_t failures;                /* accesses that failed, modulo 2^16 */
static uint8_t bytes[1u + IMU_DATA_MAX]; /* SPI: the command first */
static int16_t axes[SENSORS][3];
static uint32_t period_us; /* between two samples */
static bool gave_six_axes; /* since imu_use() */

static bool on_spi(uint32_t sensor) {
    return sensor == ACCEL && use.accel_bus == BOARD_ACCEL_SPI;
}

/* Sensors with a chip of their own: one chip with both is treated as the gyro. */
static uint32_t chip_count(void) {
    return use.accel_bus == BOARD_ACCEL_IN_GYRO ? 1u : SENSORS;
}

static const chip_t *chip_of(uint32_t sensor) {
    return chip_count() == 1u ? &mpu6050 : two_chips[sensor];
}

/* Both sensors are set up. */
static bool all_up(void) {
    return sensors[GYRO].up && (chip_count() == 1u || sensors[ACCEL].up);
}

/* Starts an access of the active sensor: reads to_read bytes, or with 0 writes bytes[1]. */
static void transfer(uint8_t reg, uint32_t to_read) {
    asked = to_read;
    age_ms = 0u;
    if (on_spi(active)) {
        bytes[0] = (uint8_t)(reg | (to_read > 0u ? SPI_READ : 0u) | (to_read > 1u ? SPI_MANY : 0u));
        spi_exchange(bytes, to_read > 0u ? 1u + to_read : 2u);
    } else {
        i2c_access(chip_of(active)->address, reg, &bytes[1], to_read);
    }
}

static void access(void) {
    const chip_t *const chip = chip_of(active);
    const chip_step_t *const step = &chip->steps[sensors[active].step];
    if (phase == SAMPLE) {
        transfer(chip->data, chip->data_bytes);
    } else if (step->action == CHIP_WRITE || step->action == CHIP_OPTION) {
        const uint32_t option = active == ACCEL ? use.accel_rate : use.gyro_filter;
        bytes[1] = (uint8_t)(step->value | (step->action == CHIP_OPTION ? option : 0u));
        transfer(step->reg, 0u);
    } else {
        transfer(step->reg, 1u);
    }
}

/* Gives the active sensor up for this cause, until RETRY_MS have passed. */
static void lose(uint8_t cause) {
    sensor_t *const s = &sensors[active];
    s->cause = cause;
    if (chip_count() == 1u) {
        sensors[ACCEL].cause = cause;
    }
    s->up = false;
    s->step = 0u;
    s->awaited_ms = 0u;
    s->wait_ms = RETRY_MS;
    tries = 0u;
    phase = cause == BOARD_SENSOR_BUS && !on_spi(active) ? RECOVER : REST;
}

/* True when the byte that was read is the one that the step of the set-up expects. */
static bool as_wanted(const chip_t *chip, const chip_step_t *step) {
    switch (step->action) {
    case CHIP_CHECK:
    case CHIP_AWAIT:
        return (bytes[1] & step->mask) == step->value;
    case CHIP_KNOWN:
        for (uint32_t i = 0u; i < chip->identity_count; i++) {
            if (chip->identities[i] == bytes[1]) {
                return true;
            }
        }
        return false;
    default:
        return true; /* it wrote */
    }
}

/* After an access of the set-up: checks it, then starts the next one or loses the sensor. */
static void next_step(void) {
    sensor_t *const s = &sensors[active];
    const chip_t *const chip = chip_of(active);
    const chip_step_t *const step = &chip->steps[s->step];
    if (!as_wanted(chip, step)) {
        if (step->action != CHIP_AWAIT) {
            lose(BOARD_SENSOR_IDENTITY);
        } else if (++s->awaited_ms >= AWAIT_MS) {
            lose(BOARD_SENSOR_SILENT);
        } else {
            phase = REST; /* read again in the next millisecond */
        }
        return;
    }
    s->step++;
    if (s->step < chip->step_count) {
        access();
        return;
    }
    s->up = true;
    phase = REST;
    if (s->cause != BOARD_SENSOR_STUCK) { /* a stuck sensor has to deliver a changed sample first */
        s->cause = BOARD_SENSOR_GOOD;
        if (chip_count() == 1u) {
            sensors[ACCEL].cause = BOARD_SENSOR_GOOD;
        }
    }
}

/* Counts samples that equal the one before. True when there are so many that the sensor is stuck. */
static bool stands_still(uint32_t sensor, bool changed) {
    sensor_t *const s = &sensors[sensor];
    const chip_t *const chip = chip_of(sensor);
    const uint32_t option = sensor == ACCEL && chip_count() > 1u ? use.accel_rate : use.gyro_filter;
    const chip_stuck_t *const least = &chip->stuck[option - chip->option_first];
    const uint32_t limit_us = 1000u * least->interval_ms * least->repeats;
    const uint32_t samples = (limit_us + period_us - 1u) / period_us;
    const uint32_t wanted = samples > least->repeats ? samples : least->repeats;
    if (changed) {
        s->same = 0u;
    } else if (s->same < wanted) {
        s->same++;
    }
    return use.stuck_ms != 0u && s->same >= wanted;
}

/* Stores the three axes of a sensor from the bytes at `place` of a sample. True when one has changed. */
static bool store_axes(uint32_t sensor, uint32_t place) {
    bool changed = false;
    for (uint32_t axis = 0u; axis <= AXIS_LAST; axis++) {
        const uint8_t *const at = &bytes[1u + place + 2u * axis];
        const uint32_t first = at[0], second = at[1];
        const uint32_t value = chip_of(sensor)->low_byte_first ? first | second << 8 : first << 8 | second;
        changed = changed || axes[sensor][axis] != (int16_t)value;
        axes[sensor][axis] = (int16_t)value;
    }
    return changed;
}

static void store_sample(void) {
    bool changed;
    if (chip_count() == 1u) {
        const bool felt = store_axes(ACCEL, 0u);
        changed = store_axes(GYRO, mpu6050.gyro_at) || felt;
        sensors[ACCEL].cause = stands_still(ACCEL, felt) ? BOARD_SENSOR_STUCK : BOARD_SENSOR_GOOD;
    } else {
        changed = store_axes(active, 0u);
    }
    sensor_t *const s = &sensors[active];
    if (stands_still(active, changed)) {
        if (s->cause == BOARD_SENSOR_GOOD) {
            lose(BOARD_SENSOR_STUCK); /* set up anew: after a dip of its supply a chip is asleep */
        }
    } else if (changed) {
        s->cause = BOARD_SENSOR_GOOD;
    }
}

static void publish(void) {
    int16_t *const raw = samples_next();
    if (use.kind == BOARD_SENSORS_SIX_AXES) {
        const bool marks = use.marks_missing != 0u;
        const bool no_rate = marks && sensors[GYRO].cause != BOARD_SENSOR_GOOD;
        const bool no_force = no_rate || (marks && sensors[ACCEL].cause != BOARD_SENSOR_GOOD);
        for (uint32_t axis = 0u; axis <= AXIS_LAST; axis++) {
            raw[axis] = no_rate ? INT16_MIN : axes[GYRO][axis];
            raw[AXIS_LAST + 1u + axis] = no_force ? INT16_MIN : axes[ACCEL][axis];
        }
        gave_six_axes = true;
    } else if (USED_WHEELS && use.kind == BOARD_SENSORS_RIDE) { /* x to the front, z up */
        raw[0] = axes[GYRO][1];
        raw[1] = axes[ACCEL][0];
        raw[2] = axes[ACCEL][AXIS_LAST];
        raw[3] = axes[GYRO][AXIS_LAST];
        ride_read(&raw[4]);
    } else { /* the rate about the wheels' axis, and the accelerations along the other two axes */
        const uint32_t axis = use.imu_axis;
        raw[0] = axes[GYRO][axis];
        raw[1] = axes[ACCEL][axis == 0u ? 1u : 0u];
        raw[2] = axes[ACCEL][axis == AXIS_LAST ? 1u : 2u];
        raw[3] = bridge_hall_count();
    }
    samples_publish();
}

/* SPI has no acknowledge: when the chip is absent, the pull-up makes all bits 1. */
static bool line_was_idle(void) {
    uint8_t all = 0xffu;
    for (uint32_t i = 0u; i < asked; i++) {
        all &= bytes[1u + i];
    }
    return on_spi(active) && asked > 0u && all == 0xffu;
}

void imu_transferred(transfer_t result) {
    if (!USED_DIGITAL || (phase != SET_UP && phase != SAMPLE)) {
        return;
    }
    if (result == TRANSFER_DONE && line_was_idle()) {
        result = TRANSFER_REFUSED;
    }
    if (result != TRANSFER_DONE) {
        failures++;
        tries++;
        if (tries < TRIES) {
            access();
        } else {
            lose(result == TRANSFER_REFUSED ? BOARD_SENSOR_NO_ANSWER : BOARD_SENSOR_BUS);
        }
        return;
    }
    tries = 0u;
    if (phase == SET_UP) {
        next_step();
        return;
    }
    store_sample();
    if (phase != SAMPLE) {
        return; /* store_sample() found the sensor stuck */
    }
    if (active == GYRO && chip_count() > 1u && sensors[ACCEL].up) {
        active = ACCEL;
        access();
    } else {
        phase = REST;
        publish();
    }
}

void imu_period(uint32_t length_us) {
    period_us = length_us;
    if (!USED_DIGITAL) {
        return;
    }
    if (!all_up()) {
        if (!gave_six_axes || use.marks_missing == 0u) {
            return;
        }
        if (!sensors[GYRO].up) {
            publish();
            return;
        }
    }
    if (phase != REST) {
        samples_miss();
        return;
    }
    phase = SAMPLE;
    active = GYRO;
    access();
}

static void start_one_of_the_lost(void) {
    for (uint32_t i = 0u; i < chip_count(); i++) {
        sensor_t *const s = &sensors[i];
        if (s->up) {
            continue;
        }
        if (s->wait_ms > 0u) {
            s->wait_ms--;
        } else if (phase == REST) {
            phase = SET_UP;
            active = i;
            access();
        }
    }
}

void imu_poll_ms(void) {
    if (!USED_DIGITAL) {
        return;
    }
    switch (phase) {
    case RECOVER:
        if (i2c_recover()) {
            phase = REST;
        }
        break;
    case REST:
        start_one_of_the_lost();
        break;
    case SET_UP:
    case SAMPLE:
        age_ms++;
        if (age_ms > ACCESS_MS) {
            failures++;
            spi_end();
            i2c_abort();
            lose(BOARD_SENSOR_BUS);
        }
        break;
    default:
        break;
    }
}

void imu_use(const board_sensors_t *wanted) {
    if (!USED_DIGITAL) {
        return;
    }
    phase = OFF;
    spi_end();
    i2c_abort();
    use = *wanted;
    const bool used = wanted->kind == BOARD_SENSORS_BALANCE || wanted->kind == BOARD_SENSORS_SIX_AXES ||
                      (USED_WHEELS && wanted->kind == BOARD_SENSORS_RIDE);
    for (uint32_t i = 0u; i < SENSORS; i++) {
        sensors[i] = (sensor_t){.cause = used ? BOARD_SENSOR_STARTING : BOARD_SENSOR_GOOD};
    }
    tries = 0u;
    gave_six_axes = false;
    if (used) {
        phase = RECOVER;
    }
}

void imu_health(board_health_t *health) {
    if (!USED_DIGITAL) {
        health->gyro = BOARD_SENSOR_GOOD;
        health->accel = BOARD_SENSOR_GOOD;
        health->bus_failures = 0u;
        return;
    }
    health->gyro = sensors[GYRO].cause;
    health->accel = sensors[ACCEL].cause;
    health->bus_failures = failures;
}
