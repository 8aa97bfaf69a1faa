/* The board as a whole: start-up order, identity, faults. */
#include "app/board.h"
#include "adc.h"
#include "app/board_guard.h"
#include "app/board_sensors.h"
#include "battery_adc.h"
#include "bridge.h"
#include "bxcan.h"
#include "clock.h"
#include "core/digest.h"
#include "entropy.h"
#include "faults.h"
#include "guard.h"
#include "image_header.h"
#include "imu.h"
#include "linker.h"
#include "motors.h"
#include "pins.h"
#include "pwm.h"
#include "receiver_lines.h"
#include "ride.h"
#include "samples.h"
#include "stall.h"
#include "stm32f103.h"
#include "strap.h"
#include "systick.h"
#include "uart.h"
#include "watchdog.h"

BOARD_GUARDED static uint32_t start_faults; /* BOARD_FAULT_*, decided once */
static board_identity_t identity;           /* told to hosts; what it decided at the start is in registers */

#define SIZE_UNREADABLE 0xffffU

/* Reads the device signature (RM0008 30) before the clock rises from 8 MHz: at 72 MHz some chips return all
 * ones, and a few always do. The device id register (DBGMCU_IDCODE) reads 0 without a debugger (erratum), so
 * the density is derived from the size of the flash. */
static void identify(void) {
    const uint32_t flash_kib = DEVICE_FLASH_KIB;
    identity.flash_kib = flash_kib == SIZE_UNREADABLE ? 0U : flash_kib;
    for (uint32_t word = 0U; word < 3U; word++) {
        identity.unique_id[word] = DEVICE_UID(word);
    }
    const bool high_density = identity.flash_kib > 128U;
    identity.part_id = high_density ? 0x414U : 0x410U;
    identity.ram_kib = high_density ? (identity.flash_kib > 256U ? 64U : 48U) : 20U;
    identity.git_hash[0] = image_header.git_hash[0];
    identity.git_hash[1] = image_header.git_hash[1];
    identity.git_dirty = image_header.git_dirty;
}

/* Finds an image that was not flashed correctly, before anything can be armed. */
static void check_image(void) {
    const uint8_t *const image = (const uint8_t *)image_start;
    const uint32_t stored = *(const volatile uint32_t *)(const void *)image_crc_address;
    if (digest_crc32(image, (size_t)(image_crc_address - image)) != stored) {
        start_faults |= BOARD_FAULT_IMAGE;
    }
}

void board_init(const board_setup_t *setup) {
    identify();
    start_faults = faults_init(&identity);
    /* A crystal that failed in the run before is not tried again, so that neutral pulses begin without delay.
     */
    if (!clock_init((start_faults & BOARD_FAULT_CRYSTAL) == 0U)) {
        start_faults |= BOARD_FAULT_CLOCK_FALLBACK;
    }
    systick_init();
    pins_clocks();
    identity.pins = strap_read();
    const bool agreed = setup->pins == identity.pins && identity.pins != BOARD_PINS_UNKNOWN;
    const uint32_t driven = agreed ? identity.pins : BOARD_PINS_UNKNOWN;
    if (!agreed) {
        start_faults |= BOARD_FAULT_STRAP;
    }
    if (board_pins_wheels(driven)) {
        ride_init(); /* before pwm_init(), which leaves a timer alone that counts a wheel */
    }
    pwm_init(driven);
    if (board_pins_bridge(driven)) {
        bridge_init(setup->dead_time_ns);
    }
    if (board_pins_wheels(driven)) {
        motors_init();
    }
    pins_init(identity.pins, agreed); /* last: the outputs become active when the timers are at neutral */
    watchdog_init();
    identity.seed = entropy_at_start();
    check_image();
    uart_init();
    can_init();
    if (board_pins_receiver(identity.pins)) {
        receiver_uart_init();
    }
    if (board_pins_pulse_train(identity.pins)) {
        ppm_capture_init();
    }
    if (board_pins_battery(identity.pins)) {
        battery_adc_init(identity.pins);
    }
    if (board_pins_bridge(driven)) {
        bridge_start();
    }
    if (board_pins_wheels(driven)) {
        motors_clear_faults(); /* of the break input, which floated before its pull resistor was on */
    }
    imu_init();
}

const board_identity_t *board_identity(void) {
    return &identity;
}

uint32_t board_faults(void) {
    const uint32_t errors = receiver_uart_errors(uart_errors()), late = samples_late();
    board_health_t health;
    board_sensor_health(&health);
    const bool sensor_bad = (health.railed | health.stuck | health.gyro | health.accel) != BOARD_SENSOR_GOOD;
    return start_faults | guard_faults() | bridge_faults() | motors_faults() |
           (stall_latched() ? BOARD_FAULT_STALLED : 0U) | (errors > 0U ? BOARD_FAULT_UART_OVERRUN : 0U) |
           (adc_failed() ? BOARD_FAULT_ADC : 0U) | (sensor_bad ? BOARD_FAULT_SENSOR : 0U) |
           (can_overrun() ? BOARD_FAULT_CAN_OVERRUN : 0U) | (late > 0U ? BOARD_FAULT_LATE : 0U) |
           (errors << BOARD_FAULT_UART_COUNT_SHIFT) | (late << BOARD_FAULT_LATE_COUNT_SHIFT);
}
