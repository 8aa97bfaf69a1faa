/* State that the files of the port share: the wires, the time, and the board as a whole. */
#include "port.h"

native_wires_t native;
port_t port;
jmp_buf port_out_of_the_loop;

void port_leave_loop(left_t how) {
    longjmp(port_out_of_the_loop, (int)how);
}

uint64_t port_now_ns(void) {
    return port.now_us * NS_PER_US;
}

uint32_t port_now_ms(void) {
    return (uint32_t)(port.now_us / 1000U);
}

void port_wake(void) {
    port.wake = true;
}

bool port_drives(void) {
    return (port.faults & BOARD_FAULT_STRAP) == 0U;
}

bool port_bridge(void) {
    return port_drives() && board_pins_bridge(port.identity.pins);
}

bool port_rotors(void) {
    return port_drives() && board_pins_rotors(port.identity.pins);
}

bool port_wheels(void) {
    return port_drives() && board_pins_wheels(port.identity.pins);
}

bool port_vehicle(void) {
    return board_pins_receiver(port.identity.pins);
}

bool port_stalled(void) {
    return port.stalled;
}

void port_watch(bool driving) {
    port.driving = driving;
}

void port_clear_stall(void) {
    port.driving = false;
    port.stalled = false;
}

const board_identity_t *board_identity(void) {
    return &port.identity;
}
