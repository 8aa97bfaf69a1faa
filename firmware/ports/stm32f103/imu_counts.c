#include "imu_counts.h"
#include "bridge.h"
#include "generated/sensor_kinds.h"
#include "generated/used_parts.h"
#include "imu_watch.h"
#include "ride.h"
#include "samples.h"
#include "stall.h"
#include <stddef.h>
#include <string.h>

#define AXIS_LAST 2U
#define ALL_AXES  7U
#define TURNS     70 /* counts of a rate: 4.3 deg/s of the MPU-6050, 4.9 of the ITG-3205 */

static int16_t axes[SENSORS][IMU_AXES];
static imu_watch_t watches[SENSORS];
static struct {
    uint8_t repeated, turns, railed; /* axes that repeat, are beyond TURNS, are at the rail; bit 0 is x */
} seen[SENSORS];                     /* in the last sample */

void imu_counts_clear(void) {
    watches[GYRO] = watches[ACCEL] = (imu_watch_t){0};
    seen[GYRO].turns = 0U;
}

static bool motors_may_turn(void) {
    return USED_ACTUATORS && stall_watches();
}

/* Axes of a sensor that the sample has; imu_counts_publish() takes them. */
static uint32_t axes_used(uint32_t sensor, const board_sensors_t *use) {
    if (board_digital_six_axes(use->kind)) {
        return ALL_AXES;
    }
    if (board_digital_ride(use->kind)) {
        return sensor == GYRO ? 6U : 5U;
    }
    return sensor == GYRO ? 1U << use->imu_axis : ALL_AXES ^ 1U << use->imu_axis;
}

/* Axes of a sensor that should have moved: all while the motors may turn, or while the gyro sees a turn about
 * another axis. */
static uint32_t should_have_moved(uint32_t sensor) {
    const uint32_t turning = seen[GYRO].turns;
    const bool about_one = (turning & (turning - 1U)) == 0U;
    if (motors_may_turn()) {
        return ALL_AXES;
    }
    return turning == 0U ? 0U : sensor == GYRO && about_one ? ALL_AXES ^ turning : ALL_AXES;
}

void imu_counts_take(uint32_t sensor, const chip_t *chip, const uint8_t *data) {
    uint32_t repeated = 0U, turns = 0U, railed = 0U;
    for (uint32_t axis = 0U; axis <= AXIS_LAST; axis++) {
        const uint32_t bit = 1U << axis;
        uint16_t pair;
        memcpy(&pair, &data[2U * axis], sizeof pair);
        const int32_t value = (int16_t)(chip->low_byte_first ? pair : __builtin_bswap16(pair));
        const int32_t size = value < 0 ? -value : value;
        repeated |= value == axes[sensor][axis] ? bit : 0U;
        turns |= size >= TURNS ? bit : 0U;
        railed |= size >= chip->rail ? bit : 0U;
        axes[sensor][axis] = (int16_t)value;
    }
    seen[sensor].repeated = (uint8_t)repeated;
    seen[sensor].turns = (uint8_t)turns;
    seen[sensor].railed = (uint8_t)railed;
}

uint8_t imu_counts_judge(uint32_t sensor, const board_sensors_t *use, const imu_still_t *still,
                         const imu_still_t *beside, uint32_t sample_us) {
    imu_watch_t *const watch = &watches[sensor];
    const uint32_t used = axes_used(sensor, use), reading_us = 1000U * still->interval_ms;
    const uint32_t longest_us =
        imu_watch_still(watch, seen[sensor].repeated, used & should_have_moved(sensor),
                        sample_us < reading_us ? sample_us : reading_us);
    if ((seen[sensor].railed | watch->railed_us) != 0U) {
        imu_watch_rail(watch, (seen[sensor].railed & used) != 0U, sample_us);
    }
    if (watch->railed) {
        return BOARD_SENSOR_RAIL;
    }
    const bool driven = motors_may_turn() && longest_us >= IMU_STILL_DRIVEN_US;
    const bool both = beside != NULL && watch->whole_us >= reading_us * beside->whole &&
                      watches[ACCEL].whole_us >= reading_us * beside->whole;
    const bool stands = driven || both || longest_us >= reading_us * still->axis ||
                        watch->whole_us >= reading_us * still->whole;
    return use->stuck_ms != 0U && stands ? BOARD_SENSOR_STUCK : BOARD_SENSOR_GOOD;
}

void imu_counts_publish(const board_sensors_t *use, bool no_rate, bool no_force) {
    int16_t *const raw = samples_next();
    if (board_digital_six_axes(use->kind)) {
        for (uint32_t axis = 0U; axis <= AXIS_LAST; axis++) {
            raw[axis] = no_rate ? INT16_MIN : axes[GYRO][axis];
            raw[AXIS_LAST + 1U + axis] = no_force ? INT16_MIN : axes[ACCEL][axis];
        }
    } else if (board_digital_ride(use->kind)) { /* x to the front, z up */
        raw[0] = axes[GYRO][1];
        raw[1] = axes[ACCEL][0];
        raw[2] = axes[ACCEL][AXIS_LAST];
        raw[3] = axes[GYRO][AXIS_LAST];
        ride_read(&raw[4]);
    } else { /* the rate about the wheels' axis, and the accelerations along the other two axes */
        const uint32_t axis = use->imu_axis;
        raw[0] = axes[GYRO][axis];
        raw[1] = axes[ACCEL][axis == 0U ? 1U : 0U];
        raw[2] = axes[ACCEL][axis == AXIS_LAST ? 1U : 2U];
        raw[3] = bridge_hall_count();
    }
    samples_publish();
}
