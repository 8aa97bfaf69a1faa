/* What the application needs of a board as a whole: start, identity, faults, time, and the turns of the loop.
 *
 * The rest of the hardware contract, by subject: board_sensors.h, board_actuators.h, board_links.h,
 * board_guard.h, board_store.h. A port in firmware/ports/ implements all of it and is chosen at link time:
 * stm32f103 for the chip, native in the memory of a PC. Every function is called from the main loop only,
 * nothing waits (board_idle sleeps), and the caller owns every buffer. */
#ifndef PLUMB_BOARD_H
#define PLUMB_BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* board_faults(). Bits 0 to 7 and 13 to 15 disarm and block arming; bits 8 to 12 only inform. */
#define BOARD_FAULT_ADC            0x0001u /* calibration did not end: counts are not to be trusted */
#define BOARD_FAULT_LATE           0x0002u /* since board_set_period_us: a period began before the last was taken */
#define BOARD_FAULT_HARD           0x0004u /* a processor fault caused the last reset: board_identity()->crash_ */
#define BOARD_FAULT_IMAGE          0x0008u /* the flash does not hold what was built: its CRC differs */
#define BOARD_FAULT_BRIDGE         0x0010u /* the break input switched the bridge off, or holds it off */
#define BOARD_FAULT_HALL           0x0020u /* all Hall sensors alike: a wire is off */
#define BOARD_FAULT_PARAMETERS     0x0080u /* the session's: what was saved cannot be used */
#define BOARD_FAULT_CLOCK_FALLBACK 0x0100u /* no crystal: internal oscillator, CAN must stay off */
#define BOARD_FAULT_UART_OVERRUN   0x0200u /* received bytes were lost or damaged */
#define BOARD_FAULT_WATCHDOG       0x0400u /* a watchdog caused the last reset */
#define BOARD_FAULT_SENSOR         0x0040u /* a sensor is lost or not to be trusted: board_sensor_health() */
#define BOARD_FAULT_CAN_OVERRUN                                                                              \
    0x0800u /* received CAN frames were lost: the loop did not fetch them in time */
#define BOARD_FAULT_STALLED                                                                                  \
    0x2000u /* while driving the loop did not come round for 20 ms: until the next run */
#define BOARD_FAULT_UPSET   0x4000u /* memory that decides a pulse was damaged: until the next start */
#define BOARD_FAULT_CRYSTAL 0x1000u /* the crystal failed in the run before: internal oscillator since */
#define BOARD_FAULT_STRAP                                                                                    \
    0x8000u /* the strap and the saved pin set disagree: no actuator is driven until the next start */
/* Two counters that stop at 255: bits 16 to 23 UART errors, bits 24 to 31 late periods. */
#define BOARD_FAULT_UART_COUNT_SHIFT 16u
#define BOARD_FAULT_LATE_COUNT_SHIFT 24u

typedef struct {
    uint32_t part_id;         /* device id: 0x410 medium density, 0x414 high density */
    uint32_t unique_id[3];    /* 96 bits */
    uint32_t git_hash[2];     /* commit, first 16 hexadecimal digits, most significant first; 0: not known */
    uint32_t git_dirty;       /* 1: built from a tree that differs from that commit */
    uint32_t flash_kib;       /* as the part says; 0: it does not say, and counts as the smallest */
    uint32_t ram_kib;         /* of the smallest part with that much flash */
    uint32_t reset_cause;     /* RCC_CSR 31..24: low power, window watchdog, watchdog, software, power, pin */
    uint32_t crash_pc;        /* with BOARD_FAULT_HARD: the instruction */
    uint32_t crash_exception; /* with BOARD_FAULT_HARD: 3 HardFault, 0 stack at its guard; with CRYSTAL: 2 */
    uint32_t pins;            /* the pin set that the strap chose, BOARD_PINS_ */
    uint32_t seed;            /* for random numbers: another one at every start */
} board_identity_t;

/* Pin sets. The strap chooses one: PB4 and PB5 open or at ground. Actuators are driven when the saved
 * parameter agrees with it. */
#define BOARD_PINS_STANDARD  0u /* both open: two speed controllers; USART1 on PA9, PA10 */
#define BOARD_PINS_BRIDGE    1u /* PB5 at ground: three-phase bridge, Hall sensors; USART1 on PB6, PB7 */
#define BOARD_PINS_QUADROTOR 2u /* PB4 at ground: not supported, drives nothing; USART1 on PA9, PA10 */
#define BOARD_PINS_UNKNOWN   3u /* both at ground, or not steady: drives nothing, no USART1 */

/* What is decided once, at start. */
typedef struct {
    uint32_t pins;         /* BOARD_PINS_ that the parameters are for */
    uint32_t dead_time_ns; /* of the bridge, 200 to 3500: rounded up */
} board_setup_t;

/* Clock, pins, UART, outputs at neutral, watchdog running. Never hangs: board_faults() says what failed. */
void board_init(const board_setup_t *setup);

const board_identity_t *board_identity(void);
uint32_t board_faults(void);

/* Microseconds since start; wraps after 71.6 minutes, never steps back otherwise. */
uint32_t board_now_us(void);

/* To be called at the beginning of every turn of the loop. While the actuators may move
 * (board_arm_actuator()), 20 ms without a turn switch the outputs to neutral, from an interrupt. They stay
 * so, whatever is asked of them, and BOARD_FAULT_STALLED is told until board_clear_actuator_faults(). */
void board_turn(void);

/* To be called in every turn of the loop that met its deadline; the board resets when that does not happen
 * for 40 ms. */
void board_feed_watchdog(void);

/* Outputs neutral, then the part's ROM bootloader: it listens on the UART's pins until the next reset. Does
 * not return. */
void board_enter_bootloader(void);

/* Sleep until there may be something to do: bytes came, a full transmit queue has room, a tick, or 1 ms went
 * by. */
void board_idle(void);

#endif
