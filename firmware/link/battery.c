#include "battery.h"
#include "generated/used_parts.h"
#include "readiness.h"

#if USED_BATTERY
enum { VOLTAGE, CURRENT };

void battery_follow(battery_t *b, bool read, const uint16_t counts[BATTERY_INPUTS]) {
    if (read) {
        b->voltage_q6 += counts[VOLTAGE] - (b->voltage_q6 >> BATTERY_SMOOTH_LOG2);
        b->current = counts[CURRENT];
        b->turns = BATTERY_TURNS;
    } else if (b->turns > 0U) {
        b->turns--;
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
    if (b->turns == 0U || railed || mv < BATTERY_LEAST_MV) {
        return READINESS_BATTERY_UNKNOWN;
    }
    return mv < params->battery_min_mv ? READINESS_BATTERY_LOW : 0U;
}

message_battery_t battery_message(const battery_t *b, const params_t *params) {
    return (message_battery_t){.voltage_mv = (uint16_t)voltage_mv(b, params),
                               .current_10ma = (uint16_t)(100U * b->current * params->battery_full_a >> 12),
                               .lowest_mv = (uint16_t)params->battery_min_mv};
}
#endif
