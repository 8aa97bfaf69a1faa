#include "imu_access.h"
#include "i2c.h"
#include "imu_counts.h"
#include "spi.h"

static const chip_t *chips[SENSORS];
static uint32_t wired_to_spi; /* bit 0 is the gyro */
static uint32_t options[SENSORS];
static uint32_t asked;                   /* bytes that the access reads; 0: it writes one */
static uint8_t bytes[1U + IMU_DATA_MAX]; /* SPI: the command first */

void imu_access_use(const board_sensors_t *wanted) {
    const imu_way_t *const way = &imu_ways[wanted->accel_bus];
    wired_to_spi = way->on_spi;
    chips[GYRO] = &imu_chips[way->chip[GYRO]];
    chips[ACCEL] = &imu_chips[way->chip[ACCEL]];
    options[GYRO] = wanted->gyro_filter;
    options[ACCEL] = imu_chip_count() > 1U ? wanted->accel_rate : wanted->gyro_filter;
    spi_divide(way->spi_divider);
}

const chip_t *imu_chip(uint32_t sensor) {
    return chips[sensor];
}

uint32_t imu_chip_count(void) {
    return chips[GYRO] == chips[ACCEL] ? 1U : SENSORS;
}

bool imu_on_spi(uint32_t sensor) {
    return (wired_to_spi >> sensor & 1U) != 0U;
}

const imu_still_t *imu_still_of(uint32_t sensor) {
    const chip_t *const chip = chips[sensor];
    const uint32_t at = options[sensor] - chip->option_first;
    const uint32_t last = chip->still_last[sensor];
    return &chip->still[sensor][at < last ? at : last];
}

/* Reads to_read bytes, or with 0 writes bytes[1]. */
static void transfer(uint32_t sensor, uint8_t reg, uint32_t to_read) {
    asked = to_read;
    if (imu_on_spi(sensor)) {
        bytes[0] = (uint8_t)(reg | (to_read > 0U ? chips[sensor]->spi_read : 0U));
        spi_exchange(bytes, to_read > 0U ? 1U + to_read : 2U);
    } else {
        i2c_access(chips[sensor]->address, reg, &bytes[1], to_read);
    }
}

/* What a step writes, or wants to read. */
static uint8_t value_of(uint32_t sensor, const chip_step_t *step) {
    return (uint8_t)(step->value | (step->action == CHIP_OPTION ? options[sensor] : 0U));
}

void imu_access_sample(uint32_t sensor) {
    transfer(sensor, chips[sensor]->data, chips[sensor]->data_bytes);
}

void imu_access_step(uint32_t sensor, uint32_t step, bool writes) {
    const chip_step_t *const at = &chips[sensor]->steps[step];
    if (writes && (at->action == CHIP_WRITE || at->action == CHIP_OPTION)) {
        bytes[1] = value_of(sensor, at);
        transfer(sensor, at->reg, 0U);
    } else {
        transfer(sensor, at->reg, 1U);
    }
}

bool imu_access_as_wanted(uint32_t sensor, uint32_t step) {
    const chip_t *const chip = chips[sensor];
    const chip_step_t *const at = &chip->steps[step];
    if (asked == 0U) {
        return true;
    }
    if (at->action != CHIP_KNOWN) {
        return ((bytes[1] ^ value_of(sensor, at)) & at->mask) == 0U;
    }
    for (uint32_t i = 0U; i < chip->identity_count; i++) {
        if (chip->identities[i] == bytes[1]) {
            return true;
        }
    }
    return false;
}

uint8_t imu_access_next_setting(uint32_t sensor, uint8_t step) {
    const chip_t *const chip = chips[sensor];
    do {
        step = (uint8_t)(step + 2U < chip->step_count ? step + 1U : 1U);
    } while (chip->steps[step].mask == 0U);
    return step;
}

bool imu_access_line_idle(uint32_t sensor) {
    uint8_t all = 0xffU;
    for (uint32_t i = 0U; i < asked; i++) {
        all &= bytes[1U + i];
    }
    return imu_on_spi(sensor) && asked > 0U && all == 0xffU;
}

uint32_t imu_access_take(uint32_t sensor) {
    const bool both = imu_chip_count() == 1U;
    const chip_t *const chip = chips[sensor];
    imu_counts_take(sensor, chip, &bytes[1U + chip->at[sensor]]);
    if (both) {
        imu_counts_take(ACCEL, chip, &bytes[1U + chip->at[ACCEL]]);
    }
    return both ? 1U << GYRO | 1U << ACCEL : 1U << sensor;
}
