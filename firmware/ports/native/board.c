/* The functions of board.h that are not in actuators.c, can.c, guard.c, sensors.c or uart.c. */
#include "port.h"

void board_init(const board_setup_t *setup) {
    port.identity = native.identity;
    port.identity.pins = native.strap;
    if (setup->pins != native.strap || native.strap >= BOARD_PINS_UNKNOWN) {
        port.faults |= BOARD_FAULT_STRAP;
    }
    if (native.no_crystal != 0U) {
        port.faults |= BOARD_FAULT_CLOCK_FALLBACK;
    }
    if (native.image_damaged != 0U) {
        port.faults |= BOARD_FAULT_IMAGE;
    }
    actuators_reset();
}

static uint32_t faults(void) {
    return native.faults | port.faults | guard_faults() | uart_faults() | can_faults() | sensors_faults() |
           actuators_faults() | (port.stalled ? BOARD_FAULT_STALLED : 0U);
}

uint32_t board_faults(void) {
    port.known = faults();
    return port.known;
}

bool board_work_waits(void) {
    return (faults() & ~port.known) != 0U || can_waits() || uart_waits();
}

uint32_t board_now_us(void) {
    const uint32_t clock_us = (uint32_t)port.now_us + port.clock_offset_us;
    if ((int32_t)(clock_us - port.last_clock_us) < 0) {
        guard_clock_upset(); /* as in ports/stm32f103/systick.c */
    }
    port.last_clock_us = clock_us;
    return clock_us;
}

void board_turn(void) {
    port.turned_us = port.now_us;
}

void board_feed_watchdog(void) {
    port.fed_us = port.now_us;
}

void board_enter_bootloader(void) {
    board_actuator_neutral();
    port_leave_loop(LEFT_BOOTLOADER);
}

/* The host lets time pass, in native_run(). */
void board_idle(void) {
    port.slept_us = port.now_us;
}
