/* The board as a machine: power, time, the turns of the loop, its sleep, the stall watch and the watchdog,
 * with the time limits of the stm32f103 port. */
#include "app/loop.h"
#include "flash.h"
#include "port.h"
#include <string.h>

#define SLEEP_US       1000U  /* longest sleep of the loop */
#define STALL_US       20000U /* ports/stm32f103/stall.c */
#define WATCHDOG_US    40000U /* ports/stm32f103/watchdog.c */
#define RESET_POWER    0x0CU  /* RCC_CSR 31..24: power and pin */
#define RESET_WATCHDOG 0x44U  /* window watchdog and pin */
#define AT_ONCE_MAX                                                                                          \
    64U /* turns of the loop at one instant: lines without delay could keep it busy for ever */

/* Counts of a level axis at rest, by the calibration of the default parameters. */
#define REST_GYRO    1676
#define REST_ACCEL_Y 2048
#define REST_ACCEL_Z 3041

/* ---- time ---- */

/* True while the loop makes turns; the rest of the board works without it. */
static bool loop_lives(void) {
    return native.state == NATIVE_RUNNING && native.hangs == 0U;
}

/* Called in every operation of the flash, once for each way of leaving it half done; fails the power when
 * fault injection asks for it. */
static void flash_at_work(void) {
    static uint32_t way;
    if (native.flash_cut == 1U && way == native.flash_cut_way) {
        native.flash_cut = 0U;
        way = 0U;
        port_leave_loop(LEFT_POWER);
    }
    way = (way + 1U) % FLASH_WAYS;
    if (way == 0U && native.flash_cut > 1U) {
        native.flash_cut--;
    }
}

/* Runs loop_start() or loop_turn(), which a power failure or the bootloader may leave in the middle. */
static void run_loop(void (*part)(void)) {
    flash_refuses = native.flash_refuses != 0U;
    switch (setjmp(port_out_of_the_loop)) {
    case LEFT_NOT:
        part();
        inside_look();
        break;
    case LEFT_BOOTLOADER:
        native.state = NATIVE_BOOTLOADER;
        break;
    default:
        native_power_off();
    }
}

static void start(uint32_t cause) {
    port = (port_t){.now_us = port.now_us, .clock_offset_us = port.clock_offset_us};
    guard_reset();
    uart_reset();
    can_reset();
    receiver_reset();
    sensors_reset();
    port.fed_us = port.turned_us = port.slept_us = port.now_us;
    port.last_clock_us = (uint32_t)port.now_us + port.clock_offset_us;
    native.identity.reset_cause = cause;
    port.faults = cause == RESET_WATCHDOG ? BOARD_FAULT_WATCHDOG : 0U;
    native.state = NATIVE_RUNNING;
    port.wake = true;
    run_loop(loop_start);
}

/* Advances the time to this instant and handles what is due then. */
static void advance_to(uint64_t us) {
    port.now_us = us;
    if (native.state != NATIVE_RUNNING) {
        return;
    }
    uart_advance();
    can_advance();
    sensors_advance();
    actuators_advance();
    if (port.driving && port.now_us - port.turned_us >= STALL_US) {
        port.stalled = true;
        board_actuator_neutral();
    }
    if (port.now_us - port.fed_us >= WATCHDOG_US) {
        native.resets++;
        native.hangs = 0U; /* the reset ends it */
        start(RESET_WATCHDOG);
    }
}

/* ns, rounded up to whole microseconds. */
static uint64_t whole_us(uint64_t ns) {
    return ns / NS_PER_US + (ns % NS_PER_US != 0U ? 1U : 0U);
}

/* Advances from event to event, to this instant or until one wakes the loop. */
static void pass_until(uint64_t until_us) {
    while (port.now_us < until_us) {
        uint64_t next_us = until_us;
        const uint64_t events[] = {
            whole_us(uart_next_ns()), whole_us(can_next_ns()), whole_us(sensors_next_ns()),
            port.driving ? port.turned_us + STALL_US : UINT64_MAX, port.fed_us + WATCHDOG_US};
        for (size_t i = 0U; i < sizeof events / sizeof events[0] && native.state == NATIVE_RUNNING; i++) {
            if (events[i] > port.now_us && events[i] < next_us) {
                next_us = events[i];
            }
        }
        advance_to(next_us);
        if (port.wake && loop_lives()) {
            return;
        }
    }
}

static void turn_and_sleep(void) {
    loop_turn();
    board_idle();
}

static void turn(void) {
    port.wake = false;
    native.turns++;
    run_loop(turn_and_sleep);
    const uint64_t end_us = port.now_us + native.turn_us;
    while (native.state == NATIVE_RUNNING && port.now_us < end_us) {
        const bool wake = port.wake;
        port.wake = false;
        pass_until(end_us); /* an event in between wakes the loop when it sleeps */
        port.wake = port.wake || wake;
    }
    uart_advance();
    can_advance();
}

static uint64_t wakes_us(void) {
    return port.wake ? port.now_us : port.slept_us + SLEEP_US;
}

void native_run(uint32_t us) {
    const uint64_t end_us = port.now_us + us;
    unsigned at_once = 0U; /* turns at this instant */
    while (port.now_us <= end_us) {
        const uint64_t due_us = !loop_lives()            ? UINT64_MAX
                                : at_once == AT_ONCE_MAX ? port.now_us + 1U
                                                         : wakes_us();
        if (due_us <= port.now_us) {
            turn();
            at_once++;
            continue;
        }
        if (port.now_us == end_us) {
            break;
        }
        at_once = 0U;
        pass_until(due_us < end_us ? due_us : end_us);
    }
}

void native_turn(uint32_t us) {
    const uint64_t end_us = port.now_us + us;
    while (port.now_us < end_us) {
        port.wake = false;
        pass_until(end_us);
    }
    uart_advance();
    can_advance();
    if (loop_lives()) {
        turn();
    }
}

uint64_t native_now_us(void) {
    return port.now_us;
}

void native_set_clock_us(uint32_t us) {
    port.clock_offset_us = us - (uint32_t)port.now_us;
    if (native.state != NATIVE_RUNNING) {
        port.last_clock_us = us;
    }
}

/* ---- power ---- */

size_t native_wires_bytes(void) {
    return sizeof native;
}

void native_defaults(void) {
    memset(&native, 0, sizeof native);
    native.identity = (board_identity_t){.part_id = 0x410U, .flash_kib = 64U, .ram_kib = 20U, .seed = 1U};
    native.raw[0] = REST_GYRO;
    native.raw[1] = REST_ACCEL_Y;
    native.raw[2] = REST_ACCEL_Z;
    native.can_kbit = 500U; /* of the default table */
    port.now_us = 0U;
    port.clock_offset_us = 0U;
    flash_blank();
    flash_half_done = flash_at_work;
    uart_unplug();
    can_unplug();
    receiver_unplug();
}

uint16_t *native_flash(void) {
    return flash.cell;
}

uint16_t *native_flash_stuck_high(void) {
    return flash_stuck_high;
}

uint32_t native_flash_operations(void) {
    return flash_operations;
}

void native_power_on(void) {
    native.resets = 0U;
    native.turns = 0U;
    start(RESET_POWER);
}

void native_power_off(void) {
    native.state = NATIVE_OFF;
    native.armed = 0U;
    for (unsigned i = 0U; i < BOARD_ACTUATORS; i++) {
        native.pulse_halfus[i] = 0U;
    }
    native.bridge_on = 0U;
    native.duty_q15 = 0;
    uart_unplug();
    can_unplug();
    receiver_unplug();
}
