/* Pulse outputs, the bridge, the motors of two wheels and the arm switch, with the bounds of
 * ports/stm32f103/pwm.c. */
#include "core/esc.h"
#include "port.h"

#define START_FRAME_HALFUS      5000U
#define CONSTANT_NEUTRAL_HALFUS 2000U

static uint32_t neutral_halfus;
static bool broken, hall_failed; /* latched until board_clear_actuator_faults() */

static uint32_t bounded(uint32_t value, uint32_t low, uint32_t high) {
    return value < low ? low : value > high ? high : value;
}

/* Pulse outputs of the pin set in use. */
static uint32_t outputs(void) {
    const uint32_t pins = board_identity()->pins;
    return !port_drives()            ? 0U
           : board_pins_pulses(pins) ? BOARD_ACTUATORS
           : port_rotors()           ? BOARD_ROTORS
                                     : 0U;
}

static void set_pulses(const uint32_t pulse_halfus[], uint32_t count) {
    for (uint32_t i = 0U; i < BOARD_ROTORS; i++) {
        native.pulse_halfus[i] = i < count ? pulse_halfus[i] : 0U;
    }
}

/* The pulses of a system, within their bounds, when the pins have as many outputs. */
static void drive(const uint32_t pulse_halfus[], uint32_t count) {
    const uint32_t fits = native.frame_halfus - ESC_GAP_MIN_HALFUS;
    const uint32_t high = fits < ESC_PULSE_MAX_HALFUS ? fits : ESC_PULSE_MAX_HALFUS;
    uint32_t pulse[BOARD_ROTORS];
    for (uint32_t i = 0U; i < count; i++) {
        pulse[i] = bounded(pulse_halfus[i], ESC_PULSE_MIN_HALFUS, high);
    }
    if (!port_stalled() && count == outputs()) {
        set_pulses(pulse, count);
    }
}

static void motors_off(void) {
    native.bridge_on = 0U;
    native.duty_q15 = 0;
    native.wheels_on = 0U;
    native.wheel_duty_q15[0] = native.wheel_duty_q15[1] = 0;
}

void actuators_reset(void) {
    broken = hall_failed = false;
    board_configure_actuator(START_FRAME_HALFUS, CONSTANT_NEUTRAL_HALFUS);
}

/* The break input, and of the bridge lost Hall sensors, switch the motors off without the loop. */
void actuators_advance(void) {
    if (!port_bridge() && !port_wheels()) {
        return;
    }
    broken = broken || native.bridge_break != 0U;
    hall_failed = hall_failed || (port_bridge() && native.hall_lost != 0U);
    if (native.bridge_break != 0U || hall_failed) {
        motors_off();
    }
}

uint32_t actuators_faults(void) {
    return (broken ? BOARD_FAULT_BRIDGE : 0U) | (hall_failed ? BOARD_FAULT_HALL : 0U);
}

void board_configure_actuator(uint32_t frame_halfus, uint32_t wanted_neutral_halfus) {
    neutral_halfus = wanted_neutral_halfus;
    board_actuator_neutral();
    native.frame_halfus = bounded(frame_halfus, ESC_FRAME_MIN_HALFUS, ESC_FRAME_MAX_HALFUS);
}

void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]) {
    drive(pulse_halfus, BOARD_ACTUATORS);
}

void board_set_rotors(const uint32_t pulse_halfus[BOARD_ROTORS]) {
    drive(pulse_halfus, BOARD_ROTORS);
}

bool board_arm_switch(void) {
    return native.arm_switch != 0U;
}

void board_arm_actuator(void) {
    port_watch(true);
    if (port_bridge() && native.bridge_break == 0U && !hall_failed && !port_stalled()) {
        native.bridge_on = 1U;
        native.duty_q15 = 0;
    }
    if (port_wheels() && native.bridge_break == 0U && !port_stalled()) {
        native.wheels_on = 1U;
    }
}

void board_set_wheels(const int32_t duty_q15[BOARD_WHEELS]) {
    if (native.wheels_on != 0U) {
        native.wheel_duty_q15[0] = duty_q15[0];
        native.wheel_duty_q15[1] = duty_q15[1];
    }
}

void board_set_bridge(int32_t duty_q15) {
    if (native.bridge_on != 0U) {
        native.duty_q15 = duty_q15;
    }
}

void board_actuator_neutral(void) {
    const bool good = neutral_halfus >= ESC_PULSE_MIN_HALFUS && neutral_halfus <= ESC_OFF_MAX_HALFUS;
    const uint32_t pulse = good ? neutral_halfus : CONSTANT_NEUTRAL_HALFUS;
    const uint32_t all[BOARD_ROTORS] = {pulse, pulse, pulse, pulse};
    set_pulses(all, outputs());
    motors_off();
    port_watch(false);
}

void board_clear_actuator_faults(void) {
    broken = hall_failed = false;
    actuators_advance(); /* sets a fault again whose cause remains */
    port_clear_stall();
}
