/* The board as a whole: power, time, sleep, the stall watch and the watchdog, with the time limits of the
 * stm32f103 port. */
#include "app/loop.h"
#include "flash.h"
#include "port.h"
#include <setjmp.h>
#include <string.h>

#define SLEEP_US       1000u  /* longest sleep of the loop */
#define STALL_US       20000u /* ports/stm32f103/stall.c */
#define WATCHDOG_US    40000u /* ports/stm32f103/watchdog.c */
#define RESET_POWER    0x0Cu  /* RCC_CSR 31..24: power and pin */
#define RESET_WATCHDOG 0x44u  /* window watchdog and pin */
#define AT_ONCE_MAX                                                                                          \
    64u /* turns of the loop at one instant: lines without delay could keep it busy for ever */

/* Counts of a level axis at rest, by the calibration of the default parameters. */
#define REST_GYRO    1676
#define REST_ACCEL_Y 2048
#define REST_ACCEL_Z 3041

typedef enum { LEFT_NOT = 0, LEFT_POWER, LEFT_BOOTLOADER } left_t;

static uint32_t clock_offset_us; /* of the board's clock to port.now_us */
static jmp_buf out_of_the_loop;

/* State that a reset clears, beside what the files share (port.h). */
static struct {
    board_setup_t setup;
    uint32_t last_clock_us;
    uint64_t slept_us;  /* when the loop went to sleep */
    uint64_t turned_us; /* when its last turn began */
    uint64_t fed_us;    /* when it last fed the watchdog */
} board;

/* ---- board.h ---- */

void board_init(const board_setup_t *setup) {
    board.setup = *setup;
    port.identity = native.identity;
    port.identity.pins = native.strap;
    if (setup->pins != native.strap || native.strap > BOARD_PINS_BRIDGE) {
        port.faults |= BOARD_FAULT_STRAP;
    }
    if (native.no_crystal != 0u) {
        port.faults |= BOARD_FAULT_CLOCK_FALLBACK;
    }
    if (native.image_damaged != 0u) {
        port.faults |= BOARD_FAULT_IMAGE;
    }
    actuators_reset();
}

uint32_t board_faults(void) {
    return native.faults | port.faults | guard_faults() | links_faults() | sensors_faults() |
           actuators_faults() | (port.stalled ? BOARD_FAULT_STALLED : 0u);
}

uint32_t board_now_us(void) {
    const uint32_t clock_us = (uint32_t)port.now_us + clock_offset_us;
    if ((int32_t)(clock_us - board.last_clock_us) < 0) {
        guard_clock_upset(); /* as in ports/stm32f103/systick.c */
    }
    board.last_clock_us = clock_us;
    return clock_us;
}

void board_turn(void) {
    board.turned_us = port.now_us;
}

void board_feed_watchdog(void) {
    board.fed_us = port.now_us;
}

void board_enter_bootloader(void) {
    board_actuator_neutral();
    longjmp(out_of_the_loop, LEFT_BOOTLOADER);
}

/* The host lets time pass, in native_run(). */
void board_idle(void) {
    board.slept_us = port.now_us;
}

/* ---- time ---- */

/* True while the loop makes turns; the rest of the board works without it. */
static bool loop_lives(void) {
    return native.state == NATIVE_RUNNING && native.hangs == 0u;
}

/* Called in every operation of the flash, once for each way of leaving it half done: power fails here when it
 * is asked for. */
static void flash_at_work(void) {
    static uint32_t way;
    if (native.flash_cut == 1u && way == native.flash_cut_way) {
        native.flash_cut = 0u;
        way = 0u;
        longjmp(out_of_the_loop, LEFT_POWER);
    }
    way = (way + 1u) % FLASH_WAYS;
    if (way == 0u && native.flash_cut > 1u) {
        native.flash_cut--;
    }
}

/* Runs loop_start() or loop_turn(), which a power failure or the bootloader may leave in the middle. */
static void run_loop(void (*part)(void)) {
    flash_refuses = native.flash_refuses != 0u;
    switch (setjmp(out_of_the_loop)) {
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
    memset(&board, 0, sizeof board);
    port = (port_t){.now_us = port.now_us};
    guard_reset();
    links_reset();
    sensors_reset();
    board.fed_us = board.turned_us = board.slept_us = port.now_us;
    board.last_clock_us = (uint32_t)port.now_us + clock_offset_us;
    native.identity.reset_cause = cause;
    port.faults = cause == RESET_WATCHDOG ? BOARD_FAULT_WATCHDOG : 0u;
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
    links_advance();
    sensors_advance();
    actuators_advance();
    if (port.driving && port.now_us - board.turned_us >= STALL_US) {
        port.stalled = true;
        board_actuator_neutral();
    }
    if (port.now_us - board.fed_us >= WATCHDOG_US) {
        native.resets++;
        native.hangs = 0u; /* the reset ends it */
        start(RESET_WATCHDOG);
    }
}

/* ns, rounded up to whole microseconds. */
static uint64_t whole_us(uint64_t ns) {
    return ns / NS_PER_US + (ns % NS_PER_US != 0u ? 1u : 0u);
}

/* Advances from event to event, to this instant or until one wakes the loop. */
static void pass_until(uint64_t until_us) {
    while (port.now_us < until_us) {
        uint64_t next_us = until_us;
        const uint64_t events[] = {whole_us(links_next_ns()), whole_us(sensors_next_ns()),
                                   port.driving ? board.turned_us + STALL_US : UINT64_MAX,
                                   board.fed_us + WATCHDOG_US};
        for (size_t i = 0u; i < sizeof events / sizeof events[0] && native.state == NATIVE_RUNNING; i++) {
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
        pass_until(end_us); /* what happens in between wakes the loop when it sleeps */
        port.wake = port.wake || wake;
    }
    links_advance();
}

static uint64_t wakes_us(void) {
    return port.wake ? port.now_us : board.slept_us + SLEEP_US;
}

void native_run(uint32_t us) {
    const uint64_t end_us = port.now_us + us;
    unsigned at_once = 0u; /* turns at this instant */
    while (port.now_us <= end_us) {
        const uint64_t due_us = !loop_lives()            ? UINT64_MAX
                                : at_once == AT_ONCE_MAX ? port.now_us + 1u
                                                         : wakes_us();
        if (due_us <= port.now_us) {
            turn();
            at_once++;
            continue;
        }
        if (port.now_us == end_us) {
            break;
        }
        at_once = 0u;
        pass_until(due_us < end_us ? due_us : end_us);
    }
}

void native_turn(uint32_t us) {
    const uint64_t end_us = port.now_us + us;
    while (port.now_us < end_us) {
        port.wake = false;
        pass_until(end_us);
    }
    links_advance();
    if (loop_lives()) {
        turn();
    }
}

uint64_t native_now_us(void) {
    return port.now_us;
}

void native_set_clock_us(uint32_t us) {
    clock_offset_us = us - (uint32_t)port.now_us;
    if (native.state != NATIVE_RUNNING) {
        board.last_clock_us = us;
    }
}

/* ---- power ---- */

size_t native_wires_bytes(void) {
    return sizeof native;
}

void native_defaults(void) {
    memset(&native, 0, sizeof native);
    native.identity = (board_identity_t){.part_id = 0x410u, .flash_kib = 64u, .ram_kib = 20u, .seed = 1u};
    native.raw[0] = REST_GYRO;
    native.raw[1] = REST_ACCEL_Y;
    native.raw[2] = REST_ACCEL_Z;
    native.can_kbit = 500u; /* of the default table */
    port.now_us = 0u;
    clock_offset_us = 0u;
    flash_blank();
    flash_half_done = flash_at_work;
    links_unplug();
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
    native.resets = 0u;
    native.turns = 0u;
    start(RESET_POWER);
}

void native_power_off(void) {
    native.state = NATIVE_OFF;
    native.armed = 0u;
    for (unsigned i = 0u; i < BOARD_ACTUATORS; i++) {
        native.pulse_halfus[i] = 0u;
    }
    native.bridge_on = 0u;
    native.duty_q15 = 0;
    links_unplug();
}
