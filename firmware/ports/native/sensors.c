/* The control period and the board's own sensors, whose counts are native.raw at the instant of the tick; and
 * the battery's inputs. */
#include "port.h"
#include <string.h>

#define FOUND_US 20000U /* a digital sensor, from board_use_sensors() on */
#define LATE_MAX 255U

static struct {
    board_sensors_t use;
    uint64_t used_ns;
    uint64_t tick_ns;   /* the next one */
    uint32_t period_us; /* 0: stopped */
    uint32_t done, taken, late;
    uint32_t faults;
    bool gave_six_axes; /* since board_use_sensors() */
    int16_t raw[BOARD_RAW_MAX];
} sensors;

void sensors_reset(void) {
    memset(&sensors, 0, sizeof sensors);
}

static bool analog(void) {
    return sensors.use.kind == BOARD_SENSORS_ANALOG_3 || sensors.use.kind == BOARD_SENSORS_ANALOG_6;
}

static bool digital(void) {
    return sensors.use.kind == BOARD_SENSORS_BALANCE || sensors.use.kind == BOARD_SENSORS_SIX_AXES ||
           sensors.use.kind == BOARD_SENSORS_RIDE;
}

static uint8_t cause(uint32_t wished) {
    if (!digital()) {
        return BOARD_SENSOR_GOOD;
    }
    const bool starting = port_now_ns() - sensors.used_ns < (uint64_t)FOUND_US * NS_PER_US;
    return (uint8_t)(wished == BOARD_SENSOR_GOOD && starting ? BOARD_SENSOR_STARTING : wished);
}

void board_sensor_health(board_health_t *health) {
    const bool watched = analog() && sensors.period_us > 0U;
    *health = (board_health_t){.railed = (uint16_t)(watched ? native.railed : 0U),
                               .stuck = (uint16_t)(watched ? native.stuck : 0U),
                               .gyro = cause(native.gyro),
                               .accel = cause(native.accel)};
}

uint32_t sensors_faults(void) {
    board_health_t health;
    board_sensor_health(&health);
    const bool bad = (health.railed | health.stuck | health.gyro | health.accel) != BOARD_SENSOR_GOOD;
    const bool dead = analog() && sensors.period_us > 0U && native.adc_dead != 0U;
    return sensors.faults | (bad ? BOARD_FAULT_SENSOR : 0U) | (dead ? BOARD_FAULT_ADC : 0U) |
           sensors.late << BOARD_FAULT_LATE_COUNT_SHIFT;
}

static bool digital_good(void) {
    return (cause(native.gyro) | cause(native.accel)) == BOARD_SENSOR_GOOD;
}

static bool gives_samples(void) {
    switch (sensors.use.kind) {
    case BOARD_SENSORS_NONE:
        return true;
    case BOARD_SENSORS_SIX_AXES:
        sensors.gave_six_axes = sensors.gave_six_axes || digital_good();
        return digital_good() || (sensors.gave_six_axes && sensors.use.marks_missing);
    case BOARD_SENSORS_BALANCE:
    case BOARD_SENSORS_RIDE:
        return digital_good();
    default:
        return native.adc_dead == 0U;
    }
}

static void sample(void) {
    static const uint8_t filled[] = {
        [BOARD_SENSORS_NONE] = 0U,    [BOARD_SENSORS_ANALOG_3] = 3U, [BOARD_SENSORS_ANALOG_6] = 6U,
        [BOARD_SENSORS_BALANCE] = 4U, [BOARD_SENSORS_SIX_AXES] = 6U, [BOARD_SENSORS_RIDE] = 7U};
    const uint32_t no_force = cause(native.accel) != BOARD_SENSOR_GOOD ? 0x38U : 0U;
    const uint32_t no_sample = cause(native.gyro) != BOARD_SENSOR_GOOD ? 0x3fU : no_force;
    const uint32_t lost = sensors.use.kind == BOARD_SENSORS_SIX_AXES ? no_sample : 0U;
    const uint32_t bad = sensors.use.kind == BOARD_SENSORS_ANALOG_6 ? native.railed | native.stuck : lost;
    for (uint32_t i = 0U; i < BOARD_RAW_MAX; i++) {
        const int32_t count = i < filled[sensors.use.kind] ? native.raw[i] : 0;
        sensors.raw[i] = (bad >> i & 1U) != 0U ? INT16_MIN : (int16_t)count;
    }
    sensors.done++;
    port_wake();
}

void sensors_advance(void) {
    while (sensors.period_us > 0U && sensors.tick_ns <= port_now_ns()) {
        sensors.tick_ns += (uint64_t)sensors.period_us * NS_PER_US;
        if (gives_samples()) {
            sample();
        }
    }
}

uint64_t sensors_next_ns(void) {
    return sensors.period_us > 0U ? sensors.tick_ns : UINT64_MAX;
}

void board_use_sensors(const board_sensors_t *wanted) {
    if (memcmp(&sensors.use, wanted, sizeof sensors.use) == 0) {
        return;
    }
    const uint32_t period_us = sensors.period_us;
    board_set_period_us(0U);
    sensors.use = *wanted;
    sensors.used_ns = port_now_ns();
    sensors.gave_six_axes = false;
    board_set_period_us(period_us);
}

void board_set_period_us(uint32_t period_us) {
    if (period_us == sensors.period_us) {
        return;
    }
    sensors.period_us = period_us;
    sensors.tick_ns = port_now_ns() + (uint64_t)period_us * NS_PER_US;
    sensors.taken = sensors.done;
    if (period_us > 0U) {
        sensors.late = 0U;
        sensors.faults &= ~BOARD_FAULT_LATE;
        memset(sensors.raw, 0, sizeof sensors.raw);
    }
}

bool board_tick_waits(void) {
    return sensors.period_us != 0U && sensors.done != sensors.taken;
}

bool board_take_tick(void) {
    if (!board_tick_waits()) {
        return false;
    }
    for (uint32_t missed = sensors.done - sensors.taken - 1U; missed > 0U && sensors.late < LATE_MAX;
         missed--) {
        sensors.late++;
        sensors.faults |= BOARD_FAULT_LATE;
    }
    sensors.taken = sensors.done;
    return true;
}

bool board_battery_read(uint16_t counts[BATTERY_INPUTS]) {
    for (uint32_t i = 0U; i < BATTERY_INPUTS; i++) {
        counts[i] = (uint16_t)native.battery[i];
    }
    return port_vehicle() && native.battery[0] != NATIVE_NEVER;
}

void board_read_sensors(int16_t raw[BOARD_RAW_MAX]) {
    memcpy(raw, sensors.raw, sizeof sensors.raw);
}
