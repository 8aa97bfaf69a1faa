#include "battery.h"
#include "readiness.h"

enum { VOLTAGE, CURRENT };

/* How many steps of the smoothing are due. After a pause only as many as the longest turn takes. */
static uint32_t steps_due(battery_t *b, uint32_t now_us) {
    const uint32_t due = (now_us - b->us) / BATTERY_STEP_US;

    b->us = due > BATTERY_STEPS_MAX ? now_us : b->us + due * BATTERY_STEP_US;
    return due > BATTERY_STEPS_MAX ? BATTERY_STEPS_MAX : due;
}

void battery_follow(battery_t *b, bool read, const uint16_t counts[BATTERY_INPUTS], uint32_t now_us) {
    const uint32_t due = steps_due(b, now_us);

    if (read) {
        for (uint32_t step = 0; step < due; step++) {
            b->voltage_q6 += counts[VOLTAGE] - (b->voltage_q6 >> BATTERY_SMOOTH_LOG2);
        }
        b->current = counts[CURRENT];
        b->known_steps = BATTERY_KNOWN_STEPS;
    } else {
        b->known_steps = (uint8_t)(b->known_steps > due ? b->known_steps - due : 0U);
    }
}

/* Below 65536, as the full scale. */
static uint32_t voltage_mv(const battery_t *b, const params_t *params) {
    return (b->voltage_q6 >> 2) * params->battery_full_mv >> 16;
}

uint16_t battery_missing(const battery_t *b, const params_t *params) {
    const uint32_t mv = voltage_mv(b, params);
    const bool railed = b->voltage_q6 >= BATTERY_RAIL << BATTERY_SMOOTH_LOG2;

    if (params->battery_min_mv == 0U) {
        return 0;
    }
    if (b->known_steps == 0U || railed || mv < BATTERY_LEAST_MV) {
        return READINESS_BATTERY_UNKNOWN;
    }
    return mv < params->battery_min_mv ? READINESS_BATTERY_LOW : 0U;
}

message_battery_t battery_message(const battery_t *b, const params_t *params) {
    return (message_battery_t){.voltage_mv = (uint16_t)voltage_mv(b, params),
                               .current_10ma = (uint16_t)(100U * b->current * params->battery_full_a >> 12),
                               .lowest_mv = (uint16_t)params->battery_min_mv};
}
