/* Gyro and accelerometer on I2C and SPI, in two chips or one: finds them, sets them up, reads both once a
 * period, reads their settings again in turn, and finds a lost one again.
 *
 * Everything here runs in interrupts of one priority: imu_period() once a period, imu_poll_ms() every
 * millisecond, imu_transferred() at the end of an access. One access is under way at a time; imu_poll_ms()
 * aborts one that takes longer than 2 ms. A failed access is tried three times; then the sensor is lost, the
 * bus is cleared, and the sensor is set up anew: a gyro at once and every millisecond, because a vehicle
 * flies without it for 50 ms, an accelerometer every 20 ms, because that keeps the bus from the gyro.
 * Without both sensors there is no sample, and so no tick; but once there was one, a system that marks what
 * is missing gets counts of INT16_MIN for all, or for the accelerations when the gyro is good. Counts that
 * are not to be trusted (imu_counts.h) are missing, too. */
#include "imu.h"
#include "generated/sensor_kinds.h"
#include "idle.h"
#include "imu_access.h"
#include "imu_counts.h"
#include "samples.h"
#include "spi.h"
#include <stddef.h>

#define TRIES     3U
#define ACCESS_MS 2U   /* reading 14 bytes takes 0.4 ms at 400 kHz */
#define RETRY_MS  20U  /* from the loss of an accelerometer to the next set-up */
#define AWAIT_MS  200U /* for the first sample: the accelerometer's slowest rate is 6.25 Hz */

/* One setting is read again behind a sample. Four of each of two chips take 160 ms with periods of 20 ms. A
 * sample and a setting take 0.6 ms. */
#define CHECK_US            10000U
#define CHECK_PERIOD_MIN_US 1000U

typedef enum { OFF, RECOVER, REST, SET_UP, SAMPLE, CHECK } phase_t;

typedef struct {
    uint8_t cause;      /* BOARD_SENSOR_*: why it is not trusted */
    bool up;            /* set up: it is read once a period */
    uint8_t step;       /* of its chip's set-up; then the setting that was read again last */
    uint8_t wait_ms;    /* until the next set-up */
    uint8_t awaited_ms; /* how long CHIP_AWAIT has waited */
} sensor_t;

static board_sensors_t use;
static volatile phase_t phase;
static sensor_t sensors[SENSORS];
static uint32_t active;        /* sensor whose access is under way */
static uint32_t age_ms, tries; /* of the access */
static uint16_t failures;      /* accesses that failed, modulo 2^16 */
static uint32_t period_us;     /* between two samples */
static uint32_t checked_us;    /* since a setting was read again */
static uint32_t checked;       /* sensor of that setting */
static bool gave_six_axes;     /* since imu_use() */
static uint32_t unjudged;      /* sensors whose last counts are not judged yet, bit 0 is the gyro */

/* Both sensors are set up. */
static bool all_up(void) {
    return sensors[GYRO].up && (imu_chip_count() == 1U || sensors[ACCEL].up);
}

static void access(void) {
    age_ms = 0U;
    if (phase == SAMPLE) {
        imu_access_sample(active);
    } else {
        imu_access_step(active, sensors[active].step, phase == SET_UP);
    }
}

/* Gives the active sensor up for this cause, until it is set up anew. */
static void lose(uint8_t cause) {
    sensor_t *const s = &sensors[active];
    s->cause = cause;
    if (imu_chip_count() == 1U) {
        sensors[ACCEL].cause = cause;
    }
    s->up = false;
    s->step = 0U;
    s->awaited_ms = 0U;
    unjudged = 0U;
    s->wait_ms = active == GYRO ? 0U : RETRY_MS;
    tries = 0U;
    phase = cause == BOARD_SENSOR_BUS && !imu_on_spi(active) ? RECOVER : REST;
    idle_tell();
}

/* After an access of the set-up: checks it, then starts the next one or loses the sensor. */
static void next_step(void) {
    sensor_t *const s = &sensors[active];
    const chip_t *const chip = imu_chip(active);
    if (!imu_access_as_wanted(active, s->step)) {
        if (chip->steps[s->step].action != CHIP_AWAIT) {
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
    s->cause = BOARD_SENSOR_GOOD;
    if (imu_chip_count() == 1U) {
        sensors[ACCEL].cause = BOARD_SENSOR_GOOD;
    }
}

/* Judges the counts of the last sample while the bus reads the next one: with both in one interrupt, a byte
 * of the receiver would wait for too long. */
static void judge_last(void) {
    const bool both = imu_chip_count() == 1U;
    for (uint32_t sensor = 0U; sensor < SENSORS; sensor++) {
        if ((unjudged >> sensor & 1U) == 0U) {
            continue;
        }
        const imu_still_t *const beside = both && sensor == GYRO ? imu_still_of(ACCEL) : NULL;
        sensors[sensor].cause = imu_counts_judge(sensor, &use, imu_still_of(sensor), beside, period_us);
    }
    unjudged = 0U;
}

static void publish(void) {
    const bool marks = use.marks_missing != 0U;
    const bool no_rate = marks && sensors[GYRO].cause != BOARD_SENSOR_GOOD;
    const bool no_force = no_rate || (marks && sensors[ACCEL].cause != BOARD_SENSOR_GOOD);
    gave_six_axes = gave_six_axes || use.kind == BOARD_SENSORS_SIX_AXES;
    imu_counts_publish(&use, no_rate, no_force);
}

/* Ends a sample; when it is time, reads the next setting again: after a dip of its supply a chip is asleep,
 * and its counts stand still. A shorter period has room for that only once something is wrong. */
static void check_in_turn(void) {
    phase = REST;
    checked_us += period_us;
    const bool good = (sensors[GYRO].cause | sensors[ACCEL].cause) == BOARD_SENSOR_GOOD;
    if (checked_us < CHECK_US || (good && period_us < CHECK_PERIOD_MIN_US)) {
        return;
    }
    checked_us = 0U;
    checked = checked == GYRO && imu_chip_count() > 1U && sensors[ACCEL].up ? ACCEL : GYRO;
    active = checked;
    sensors[active].step = imu_access_next_setting(active, sensors[active].step);
    phase = CHECK;
    access();
}

/* After a setting was read again: three readings in a row that are wrong mean that it is lost. */
static void end_check(void) {
    phase = REST;
    if (imu_access_as_wanted(active, sensors[active].step)) {
        tries = 0U;
    } else if (++tries < TRIES) {
        phase = CHECK;
        access();
    } else {
        lose(BOARD_SENSOR_IDENTITY);
    }
}

void imu_transferred(transfer_t result) {
    if (phase < SET_UP) {
        return;
    }
    if (result == TRANSFER_DONE && imu_access_line_idle(active)) {
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
    if (phase == CHECK) {
        end_check();
        return;
    }
    tries = 0U;
    if (phase == SET_UP) {
        next_step();
        return;
    }
    unjudged |= imu_access_take(active);
    if (active == GYRO && imu_chip_count() > 1U && sensors[ACCEL].up) {
        active = ACCEL;
        access();
    } else {
        publish();
        check_in_turn();
    }
}

void imu_period(uint32_t length_us) {
    period_us = length_us;
    if (!all_up()) {
        if (!gave_six_axes || use.marks_missing == 0U) {
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
    judge_last();
}

/* The sensor whose access was not the last one comes first. */
static void start_one_of_the_lost(void) {
    for (uint32_t n = 1U; n <= imu_chip_count(); n++) {
        const uint32_t i = (active + n) % imu_chip_count();
        sensor_t *const s = &sensors[i];
        if (s->up) {
            continue;
        }
        if (s->wait_ms > 0U) {
            s->wait_ms--;
        } else if (phase == REST) {
            phase = SET_UP;
            active = i;
            access();
        }
    }
}

void imu_poll_ms(void) {
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
    case CHECK:
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
    phase = OFF;
    spi_end();
    i2c_abort();
    use = *wanted;
    imu_access_use(wanted);
    const bool used = board_sensors_digital(wanted->kind);
    for (uint32_t i = 0U; i < SENSORS; i++) {
        sensors[i] = (sensor_t){.cause = used ? BOARD_SENSOR_STARTING : BOARD_SENSOR_GOOD};
    }
    imu_counts_clear();
    unjudged = 0U;
    tries = 0U;
    gave_six_axes = false;
    if (used) {
        phase = imu_on_spi(GYRO) ? REST : RECOVER;
    }
}

void imu_health(board_health_t *health) {
    health->gyro = sensors[GYRO].cause;
    health->accel = sensors[ACCEL].cause;
    health->bus_failures = failures;
}
