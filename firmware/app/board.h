/* The whole hardware contract: what the application needs from a board, and nothing about how.
 *
 * Chosen at link time; firmware/ports/stm32f103 is one implementation. Everything is called from the main
 * loop only, nothing here waits (board_idle sleeps), and the caller owns every buffer. */
#ifndef PLUMB_BOARD_H
#define PLUMB_BOARD_H

#include "link/e2e.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BOARD_RAW_MAX   6u /* raw counts of one sample; a system uses the first few */
#define BOARD_ACTUATORS 2u /* pulse outputs */

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

/* Which sensors a tick samples. */
typedef enum {
    BOARD_SENSORS_NONE = 0, /* ticks alone: samples come from the host */
    BOARD_SENSORS_ANALOG_3, /* PA0 to PA2 */
    BOARD_SENSORS_ANALOG_6, /* PA0 to PA3, PB0, PB1; INT16_MIN where an input is at a rail or hangs */
    BOARD_SENSORS_BALANCE   /* angular rate and two accelerations of the digital sensors */
} board_sensor_kind_t;

typedef struct {
    uint32_t kind;            /* board_sensor_kind_t */
    uint32_t oversample_log2; /* 0 to 4: scans of the analog inputs per period */
    uint32_t rail_ms;         /* time at a rail, at least 3 conversions, that makes a fault; 0: never */
    uint32_t stuck_ms;     /* time without any change, at least 3 conversions; digital sensors have limits of
                              their own, as their noise allows; 0: never, for these too */
    uint32_t accel_on_spi; /* 0: the accelerometer is on I2C */
    uint32_t accel_rate;   /* ADXL345 BW_RATE: 0 to 15 */
    uint32_t gyro_filter;  /* ITG-3205 DLPF_CFG: 0 to 6 */
    uint32_t imu_axis;     /* of the wheels: 0 x, 1 y, 2 z */
} board_sensors_t;

/* Why a digital sensor is not to be trusted. */
typedef enum {
    BOARD_SENSOR_GOOD = 0,  /* or not in use */
    BOARD_SENSOR_STARTING,  /* not found yet */
    BOARD_SENSOR_NO_ANSWER, /* nobody answers where it should be */
    BOARD_SENSOR_BUS,       /* the bus hangs, or an access took too long */
    BOARD_SENSOR_IDENTITY,  /* another chip answers, or it did not take its settings */
    BOARD_SENSOR_SILENT,    /* it has no data */
    BOARD_SENSOR_STUCK      /* its data do not change */
} board_sensor_cause_t;

typedef struct {
    uint16_t railed;       /* one bit an analog input */
    uint16_t stuck;        /* one bit an analog input */
    uint8_t gyro;          /* board_sensor_cause_t */
    uint8_t accel;         /* board_sensor_cause_t */
    uint16_t bus_failures; /* accesses of digital sensors that failed, modulo 2^16 */
} board_health_t;

/* One period of six inputs converted once; twice that for every step of oversample_log2. */
#define BOARD_SCAN_US 50u

/* Choose the sensors. Digital ones are found, set up and watched from here on, whether a period runs or not;
 * they need some 20 ms. The same again changes nothing. */
void board_use_sensors(const board_sensors_t *wanted);

void board_sensor_health(board_health_t *health);

/* Start the control period, 50 us to 131072 us (an odd number above 65536 us is rounded down): the sensors
 * are sampled by hardware and one tick per period follows, the first after a period. 0 stops it. The same
 * value again changes nothing. */
void board_set_period_us(uint32_t period_us);

/* True once per control period, when that period's sensors are ready; while one of them gives nothing, never.
 */
bool board_take_tick(void);

/* Raw counts of the last tick, 0 for places the sensors do not fill. */
void board_read_sensors(int16_t raw[BOARD_RAW_MAX]);

/* Outputs at neutral; then the length of a frame of pulses and the neutral pulse, half-microseconds, bounded
 * as core/esc.h says (another neutral pulse becomes 1 ms). Takes effect with the next frame. */
void board_configure_actuator(uint32_t frame_halfus, uint32_t neutral_halfus);

/* Pulse lengths in half-microseconds, bounded as core/esc.h says; both take effect at the start of the next
 * frame. */
void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]);

/* Whether the arm switch is closed at this moment, bounces and all. */
bool board_arm_switch(void);

/* The arming is over: from now on the outputs may leave neutral. Switches the bridge on, at duty 0; once the
 * break input has switched it off, only this can do it again. */
void board_arm_actuator(void);

/* Bridge: the motor gets this share of its supply, -32767..32767; positive makes board_hall_count() grow.
 * Nothing happens with other pins, or while the bridge is off. */
void board_set_bridge(int32_t duty_q15);

/* Edges of the Hall sensors, forward less backward, modulo 2^16; 0 with other pins. */
int16_t board_hall_count(void);

/* The one safe state: every output at the neutral pulse, every switch of the bridge off. */
void board_actuator_neutral(void);

/* Forget what the bridge reported, where it is no longer so. */
void board_clear_bridge_faults(void);

/* Bytes received so far, up to room. */
size_t board_uart_read(uint8_t *bytes, size_t room);

/* How many bytes board_uart_write() would accept now. */
size_t board_uart_room(void);

/* Queue bytes for sending; returns how many were accepted. */
size_t board_uart_write(const uint8_t *bytes, size_t count);

/* How the CAN controller fares (ISO 11898-1). */
typedef struct {
    uint8_t transmit_errors; /* counter of the standard; its ninth bit is bus_off */
    uint8_t receive_errors;
    uint8_t last_error; /* 0 none since, 1 stuff, 2 form, 3 acknowledgement, 4 bit recessive, 5 bit dominant,
                           6 CRC */
    bool bus_off;       /* off the bus: for ever without a crystal, else until the pause is over */
    uint16_t bus_offs;  /* times it went off, modulo 2^16 */
} board_can_health_t;

/* Be on the CAN bus at this rate, for these identifiers and no others: to be called in every turn of the
 * loop, which also brings the board back after it went off the bus, after a pause that doubles up to a
 * second. kbit: a divisor of 2000 from 125 to 1000; the same values again change nothing. ids: up to 56, kept
 * by the caller. */
void board_can_join(uint32_t kbit, const uint16_t *ids, size_t count);

/* The oldest received frame; false when there is none. */
bool board_can_read(can_frame_t *frame);

/* True when board_can_send() would take a frame. */
bool board_can_room(void);

/* Send a frame; frames go out in the order they were given. One that finds no way for half a second is given
 * up. */
void board_can_send(const can_frame_t *frame);

const board_can_health_t *board_can_health(void);

/* Objects with one of these attributes decide whether and how something moves. A check word is kept over each
 * of the two areas, over every object that is placed there. Only the main loop may write them, and nothing
 * may while it is in board_idle(). Their first value is 0. */
#define BOARD_GUARDED            __attribute__((section(".bss.guarded")))
#define BOARD_GUARDED_PARAMETERS __attribute__((section(".bss.guarded_parameters")))

/* To be called when the loop goes idle: what BOARD_GUARDED holds is right. */
void board_memory_seal(void);

/* Instead: it is not to be checked until the next seal. */
void board_memory_release(void);

/* To be called at once after a change: what BOARD_GUARDED_PARAMETERS holds is right. */
void board_parameters_seal(void);

/* Before guarded memory is used again: true when both areas are as they were sealed, or released. False
 * latches BOARD_FAULT_UPSET until the next start. */
bool board_memory_intact(void);

/* To be called at the beginning of every turn of the loop. While the actuators may move
 * (board_arm_actuator()), 20 ms without a turn switch the outputs to neutral, from an interrupt. They stay
 * so, whatever is asked of them, and BOARD_FAULT_STALLED is told until board_clear_stall(). */
void board_turn(void);
void board_clear_stall(void);

/* To be called in every turn of the loop that met its deadline; the board resets when that does not happen
 * for 40 ms. */
void board_feed_watchdog(void);

/* Two slots of flash that keep what is saved, of BOARD_STORE_HALFWORDS each. Readable at any time, before
 * board_init() too. */
#define BOARD_STORE_SLOTS     2u
#define BOARD_STORE_HALFWORDS 1024u
const uint16_t *board_store_slot(uint32_t slot);

/* Erase a slot: all its bits become 1. The processor stands still for up to 80 ms and feeds the watchdog:
 * only while nothing moves. False: refused. A worn bit shows when it is programmed. */
bool board_store_erase(uint32_t slot);

/* Program one erased half-word; 0 may be programmed over anything. 70 us. False: refused. */
bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value);

/* Outputs neutral, then the part's ROM bootloader: it listens on the UART's pins until the next reset. Does
 * not return. */
void board_enter_bootloader(void);

/* Sleep until there may be something to do: bytes came, a full transmit queue has room, a tick, or 1 ms went
 * by. */
void board_idle(void);

#endif
