/* A board in the memory of a PC: app/loop.c, the shipped main loop, in a process that a host drives.
 *
 *     native_defaults();
 *     native_power_on();
 *     native_uart_send(bytes, count);     what the host says
 *     native_run(1000);                   lets 1 ms pass: the loop sleeps and wakes as on the chip
 *     native_uart_receive(bytes, room);   what the board says
 *
 * Time is simulated and passes in native_run() alone; a turn of the loop takes none unless turn_us says so.
 * The same calls give the same bytes. There is one board, as there is one loop: who needs two loads the
 * library twice.
 *
 * `native` holds the wires of the board and its ways to misbehave. Write its fields between two calls; all
 * are 32 bits wide, and the order is that of host/plumb's NativeWires. */
#ifndef PLUMB_NATIVE_H
#define PLUMB_NATIVE_H

#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_sensors.h"
#include <stddef.h>

#define NATIVE_NEVER 0xFFFFFFFFu /* of a time: stands still */

typedef enum {
    NATIVE_OFF = 0, /* no power: native_power_on() starts it */
    NATIVE_RUNNING = 1,
    NATIVE_BOOTLOADER = 2 /* the application has left for the ROM bootloader */
} native_state_t;

typedef struct {
    /* The part, taken over at power-on. */
    board_identity_t identity;

    /* Wires that the board reads. */
    int32_t raw[BOARD_RAW_MAX]; /* counts of its own sensors, as a sample delivers them */
    uint32_t arm_switch;        /* 1: closed */
    uint32_t strap;             /* BOARD_PINS_, read at power-on */
    uint32_t bridge_break;      /* 1: the break input is active */
    uint32_t hall_lost;         /* 1: all Hall sensors alike */
    uint32_t uart_in_byte_ns;   /* time of a byte to the board: 10851 at 921600 baud, 0: none */
    uint32_t uart_out_byte_ns;  /* and from it; NATIVE_NEVER: the transmitter hangs */
    uint32_t can_kbit;          /* of the bus; 0: no other node is there, so nobody acknowledges */
    uint32_t can_frame_ns;      /* time of a frame: 130000 at 1 Mbit/s, 0: none */

    /* Misbehaviour on request; 0: none. */
    uint32_t faults;        /* BOARD_FAULT_ bits that are told beside its own */
    uint32_t railed, stuck; /* analog inputs that count as railed or stuck, one bit each */
    uint32_t gyro, accel;   /* BOARD_SENSOR_: why a digital sensor is not to be trusted; it gives no data */
    uint32_t adc_dead;      /* conversions do not come */
    uint32_t uart_damaged;  /* so many bytes to come are lost with a framing error */
    uint32_t can_dead;      /* every frame meets an error: the controller goes off the bus, again and again */
    uint32_t no_crystal;    /* at power-on: internal oscillator, CAN stays off */
    uint32_t image_damaged; /* at power-on: the image's CRC differs */
    uint32_t hangs;         /* the loop does not come round any more */
    uint32_t turn_us;       /* what a turn of the loop takes */
    uint32_t flash_refuses; /* no cell is erased or programmed */
    uint32_t flash_cut;     /* power fails in the middle of this operation of the flash, counted from 1 */
    uint32_t flash_cut_way; /* which bits were done by then: 0 to 3, see flash.h */

    /* What the board shows outside. */
    uint32_t state;                         /* native_state_t */
    uint32_t resets;                        /* by a watchdog, since power-on */
    uint32_t pulse_halfus[BOARD_ACTUATORS]; /* pulse outputs; 0: the pins are not driven */
    uint32_t frame_halfus;
    uint32_t bridge_on; /* 1: the bridge is switched on */
    int32_t duty_q15;   /* of the bridge, 0 while it is off */
    uint32_t bus_offs;  /* times it went off the CAN bus */
    uint32_t turns;     /* of the loop, since power-on */

    /* A look inside. */
    uint32_t armed;        /* 1: the session is armed */
    uint32_t steps;        /* number of the next step of the run */
    uint32_t receive_room; /* bytes that the session would take */
} native_wires_t;

extern native_wires_t native;

/* A frame of the CAN bus; identifiers of 11 bits, 8 bytes. */
typedef struct {
    uint32_t id;
    uint32_t dlc;
    uint8_t data[8];
} native_frame_t;

size_t native_wires_bytes(void);

/* Wires as on a desk: sensors at rest by the default table's calibration, the switch open, the strap open,
 * both links there and taking no time; nothing misbehaves. The flash is blank. */
void native_defaults(void);

/* From reset to the first turn of the loop. All memory but the flash starts at zero. */
void native_power_on(void);
void native_power_off(void);

/* Let time pass; the loop sleeps up to 1 ms, or until something wakes it. */
void native_run(uint32_t us);

/* Let time pass while the loop does nothing, then wake it for one turn. */
void native_turn(uint32_t us);

/* Microseconds since native_defaults(); and another count for the board's clock from now on: time jumps. */
uint64_t native_now_us(void);
void native_set_clock_us(uint32_t us);

/* Bytes to the board; returns how many the line takes now. And from the board. */
size_t native_uart_send(const uint8_t *bytes, size_t count);
size_t native_uart_receive(uint8_t *bytes, size_t room);

/* Frames to the board, false when the bus has no room; and from it, false when there is none. */
bool native_can_send(const native_frame_t *frame);
bool native_can_receive(native_frame_t *frame);

/* The half-words of the saved parameters' flash, FLASH_CELLS of them, and those whose bits are worn (always
 * 1). */
uint16_t *native_flash(void);
uint16_t *native_flash_stuck_high(void);
uint32_t native_flash_operations(void);

/* Guarded memory (BOARD_GUARDED, BOARD_GUARDED_PARAMETERS): its bytes, and one of its bits flipped. */
size_t native_guarded_bytes(void);
void native_flip(size_t at, uint32_t bit);

#endif
