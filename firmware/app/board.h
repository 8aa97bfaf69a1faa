/* Hardware interface of the application: start, identity, faults, time, and the turns of the loop.
 *
 * The rest of the interface, by subject: board_sensors.h, board_actuators.h, board_links.h, board_guard.h,
 * board_store.h. A port in firmware/ports/ implements all of it and is chosen at link time: stm32f103 for the
 * chip, native in the memory of a PC. Only the main loop calls these functions; none of them blocks, except
 * board_idle(), which sleeps; the caller owns every buffer. */
#ifndef PLUMB_BOARD_H
#define PLUMB_BOARD_H

#include "generated/pin_sets.h"
#include <stdbool.h>
#include <stdint.h>

/* board_faults(). Bits 0 to 7 and 13 to 15 disarm and block arming; bits 8 to 12 only inform. */
#define BOARD_FAULT_ADC            0x0001U /* no conversions, or calibration did not end */
#define BOARD_FAULT_LATE           0x0002U /* a period was not taken in time; session: no step came */
#define BOARD_FAULT_HARD           0x0004U /* a processor fault caused the last reset: identity, crash_ */
#define BOARD_FAULT_IMAGE          0x0008U /* the CRC of the image in flash is wrong */
#define BOARD_FAULT_BRIDGE         0x0010U /* the break input switched the bridge off, or holds it off */
#define BOARD_FAULT_HALL           0x0020U /* all Hall sensors alike: a wire is open */
#define BOARD_FAULT_SENSOR         0x0040U /* a sensor is lost or not trusted: board_sensor_health() */
#define BOARD_FAULT_PARAMETERS     0x0080U /* set by the session: the saved parameters cannot be used */
#define BOARD_FAULT_CLOCK_FALLBACK 0x0100U /* no crystal: internal oscillator, CAN stays off */
#define BOARD_FAULT_UART_OVERRUN   0x0200U /* received bytes were lost or damaged */
#define BOARD_FAULT_WATCHDOG       0x0400U /* a watchdog caused the last reset */
#define BOARD_FAULT_CAN_OVERRUN    0x0800U /* received CAN frames were lost: not fetched in time */
#define BOARD_FAULT_CRYSTAL        0x1000U /* the crystal failed before the last reset */
#define BOARD_FAULT_STALLED        0x2000U /* armed, no turn of the loop for 20 ms; until the next run */
#define BOARD_FAULT_UPSET          0x4000U /* guarded memory was damaged; until the next start */
#define BOARD_FAULT_STRAP          0x8000U /* strap and saved pin set differ: no actuator is driven */
/* Two counters that stop at 255: bits 16 to 23 UART errors, bits 24 to 31 late periods. */
#define BOARD_FAULT_UART_COUNT_SHIFT 16U
#define BOARD_FAULT_LATE_COUNT_SHIFT 24U

typedef struct {
    uint32_t part_id;         /* device id: 0x410 medium density, 0x414 high density */
    uint32_t unique_id[3];    /* 96 bits */
    uint32_t git_hash[2];     /* commit, first 16 hexadecimal digits, most significant first; 0: unknown */
    uint32_t git_dirty;       /* 1: built from a tree that differs from that commit */
    uint32_t flash_kib;       /* from the part's size register; 0: unreadable, taken as the smallest part */
    uint32_t ram_kib;         /* of the smallest part with that much flash */
    uint32_t reset_cause;     /* RCC_CSR 31..24: low power, window watchdog, watchdog, software, power, pin */
    uint32_t crash_pc;        /* with BOARD_FAULT_HARD: the instruction */
    uint32_t crash_exception; /* with BOARD_FAULT_HARD: 3 HardFault, 0 stack at its guard; with CRYSTAL: 2 */
    uint32_t pins;            /* the pin set that the strap chose, BOARD_PINS_ */
    uint32_t seed;            /* for random numbers: differs at every start */
} board_identity_t;

/* Settings that apply once, at start. */
typedef struct {
    uint32_t pins;         /* BOARD_PINS_ of the parameters */
    uint32_t dead_time_ns; /* of the bridge, 200 to 3500; rounded up to timer counts */
} board_setup_t;

/* Start clock, pins, UART and watchdog, with the outputs at neutral. Never hangs: board_faults() says what
 * failed. */
void board_init(const board_setup_t *setup);

const board_identity_t *board_identity(void);
uint32_t board_faults(void);

/* Microseconds since start, modulo 2^32 (71.6 minutes); never steps back otherwise. */
uint32_t board_now_us(void);

/* Call at the beginning of every whole turn of the loop. While the actuators may move (after
 * board_arm_actuator()), an interrupt sets the outputs to neutral when no turn begins for 20 ms. The outputs
 * then ignore every command, and BOARD_FAULT_STALLED is set, until board_clear_actuator_faults(). */
void board_turn(void);

/* True when a turn of the loop has work: bytes of the UART or frames of CAN wait to be fetched, or since the
 * last board_turn() an interrupt has found that a sensor is lost. A board may leave bytes of an unfinished
 * line to the pause behind them, and may count any new fault as work. */
bool board_work_waits(void);

/* Call in every turn of the loop that met its deadline; after 40 ms without a call the board resets. */
void board_feed_watchdog(void);

/* Set the outputs to neutral and start the part's ROM bootloader, which listens on the UART's pins until the
 * next reset. Does not return. */
void board_enter_bootloader(void);

/* Sleep until there may be work: bytes arrived, a full transmit queue has room again, a tick, or 1 ms passed.
 */
void board_idle(void);

#endif
