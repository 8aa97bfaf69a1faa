/* Native board: app/loop.c, the shipped main loop, on a board simulated in the memory of a PC.
 *
 *     native_defaults();
 *     native_power_on();
 *     native_uart_send(bytes, count);     bytes from the host
 *     native_run(1000);                   lets 1 ms pass: the loop sleeps and wakes as on the chip
 *     native_uart_receive(bytes, room);   bytes to the host
 *
 * Time is simulated and passes only in native_run() and native_turn(); a turn of the loop takes turn_us, by
 * default none. The same calls give the same bytes. The library holds one board; load it twice for two.
 *
 * `native` holds the wires of the board and its fault injection. Write its fields between two calls. All are
 * 32 bits wide, in the order of NativeWires in host/plumb. */
#ifndef PLUMB_NATIVE_H
#define PLUMB_NATIVE_H

#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_battery.h"
#include "app/board_sensors.h"
#include <stddef.h>

#define NATIVE_NEVER 0xFFFFFFFFU /* of a time: stands still */

typedef enum {
    NATIVE_OFF = 0, /* no power: native_power_on() starts it */
    NATIVE_RUNNING = 1,
    NATIVE_BOOTLOADER = 2 /* the application has left for the ROM bootloader */
} native_state_t;

typedef struct {
    /* The part, read at power-on. */
    board_identity_t identity;

    /* Wires that the board reads. */
    int32_t raw[BOARD_RAW_MAX];       /* counts of its own sensors, as a sample delivers them */
    uint32_t arm_switch;              /* 1: closed */
    uint32_t strap;                   /* BOARD_PINS_, read at power-on */
    uint32_t bridge_break;            /* 1: the break input is active */
    uint32_t hall_lost;               /* 1: all Hall sensors alike */
    uint32_t uart_in_byte_ns;         /* time of a byte to the board: 10851 at 921600 baud; 0: no time */
    uint32_t uart_out_byte_ns;        /* time of a byte from the board; NATIVE_NEVER: the transmitter hangs */
    uint32_t receiver_byte_ns;        /* time of a byte of the receiver: 23810 at 420 kBd; 0: no time */
    uint32_t battery[BATTERY_INPUTS]; /* counts of voltage and current; the first NATIVE_NEVER: none come */
    uint32_t can_kbit;                /* of the bus; 0: no other node is there to acknowledge frames */
    uint32_t can_frame_ns;            /* time of a frame: 130000 at 1 Mbit/s; 0: no time */

    /* Fault injection; 0: no fault. */
    uint32_t faults;        /* BOARD_FAULT_ bits, reported in addition to the board's own */
    uint32_t railed, stuck; /* analog inputs that count as railed or stuck, one bit each */
    uint32_t gyro, accel;   /* BOARD_SENSOR_ cause of a digital sensor that gives no data */
    uint32_t adc_dead;      /* the ADC delivers no conversions */
    uint32_t uart_damaged;  /* the next so many bytes are lost with a framing error */
    uint32_t can_dead;      /* every frame meets an error: the controller goes bus-off again and again */
    uint32_t no_crystal;    /* at power-on: internal oscillator, CAN stays off */
    uint32_t image_damaged; /* at power-on: the image's CRC is wrong */
    uint32_t hangs;         /* the loop makes no more turns */
    uint32_t turn_us;       /* duration of a turn of the loop */
    uint32_t flash_refuses; /* no cell is erased or programmed */
    uint32_t flash_cut;     /* power fails in the middle of this operation of the flash, counted from 1 */
    uint32_t flash_cut_way; /* which bits are done by then: 0 to 3, see flash.h */

    /* Outputs. */
    uint32_t state;                      /* native_state_t */
    uint32_t resets;                     /* by a watchdog, since power-on */
    uint32_t pulse_halfus[BOARD_ROTORS]; /* pulse outputs, two or four; 0: a pin is not driven */
    uint32_t frame_halfus;
    uint32_t bridge_on;                   /* 1: the bridge is switched on */
    int32_t duty_q15;                     /* of the bridge, 0 while it is off */
    uint32_t wheels_on;                   /* 1: the motors of both wheels are switched on */
    int32_t wheel_duty_q15[BOARD_WHEELS]; /* 0 while they are off */
    uint32_t bus_offs;                    /* how often the CAN controller went bus-off */
    uint32_t turns;                       /* of the loop, since power-on */

    /* Internal state. */
    uint32_t armed;        /* 1: the session is armed */
    uint32_t steps;        /* number of the next step of the run */
    uint32_t receive_room; /* bytes that the session would accept */
} native_wires_t;

extern native_wires_t native;

/* A frame of the CAN bus; identifiers of 11 bits, 8 bytes. */
typedef struct {
    uint32_t id;
    uint32_t dlc;
    uint8_t data[8];
} native_frame_t;

size_t native_wires_bytes(void);

/* Set the wires of a board at rest: sensor counts by the calibration of the default parameters, switch and
 * strap open, both links connected and without delay, no fault injected. The flash is blank. */
void native_defaults(void);

/* Start the board, up to the first turn of the loop. All memory but the flash starts at zero. */
void native_power_on(void);
void native_power_off(void);

/* Let time pass while the loop runs: it sleeps up to 1 ms, or until something wakes it. */
void native_run(uint32_t us);

/* Let time pass while the loop does nothing, then wake it for one turn. */
void native_turn(uint32_t us);

/* Microseconds since native_defaults(). native_set_clock_us() lets the board's own clock jump to this count.
 */
uint64_t native_now_us(void);
void native_set_clock_us(uint32_t us);

/* Bytes to and from the board; return how many bytes were taken or delivered. */
size_t native_uart_send(const uint8_t *bytes, size_t count);
size_t native_uart_receive(uint8_t *bytes, size_t room);

/* Bytes of the receiver; returns how many the line took. The board receives them in the
 * pin sets `quadrotor` and `wheels`. */
size_t native_receiver_send(const uint8_t *bytes, size_t count);

/* A rising edge of the receiver's pulse train at that time of the board, not before the edges so far; returns
 * how many the line took. */
size_t native_receiver_edge(uint64_t at_us);

/* Frames to the board, false when the bus has no room; frames from the board, false when there is none. */
bool native_can_send(const native_frame_t *frame);
bool native_can_receive(native_frame_t *frame);

/* The half-words of the flash of saved parameters, FLASH_CELLS of them; a mask of worn bits (always 1) for
 * each; and the number of operations so far. */
uint16_t *native_flash(void);
uint16_t *native_flash_stuck_high(void);
uint32_t native_flash_operations(void);

/* Guarded memory (BOARD_GUARDED, BOARD_GUARDED_PARAMETERS): its size in bytes; flip one of its bits. */
size_t native_guarded_bytes(void);
void native_flip(size_t at, uint32_t bit);

#endif
