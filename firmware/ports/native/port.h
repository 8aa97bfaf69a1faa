/* Functions that the files of this port share. The host uses native.h only. */
#ifndef PLUMB_NATIVE_PORT_H
#define PLUMB_NATIVE_PORT_H

#include "app/board_guard.h"
#include "app/board_links.h"
#include "app/board_store.h"
#include "native.h"
#include <setjmp.h>

#define NS_PER_US 1000U

/* Written by board.c and machine.c; a reset clears all but the first two. */
typedef struct {
    uint64_t now_us;
    uint32_t clock_offset_us; /* of the board's clock to now_us */
    uint32_t last_clock_us;   /* what the loop read last of the board's clock */
    uint64_t turned_us;       /* when the last turn of the loop began */
    uint64_t slept_us;        /* when it went to sleep */
    uint64_t fed_us;          /* when it last fed the watchdog */
    board_identity_t identity;
    uint32_t faults; /* BOARD_FAULT_ bits of the board as a whole */
    uint32_t known;  /* those of all parts that the loop has fetched last */
    bool wake;       /* the loop is to make a turn */
    bool driving;    /* the actuators may move: the stall watch is on */
    bool stalled;
} port_t;

extern port_t port;

/* How the loop is left in the middle of a turn. */
typedef enum { LEFT_NOT = 0, LEFT_POWER, LEFT_BOOTLOADER } left_t;

extern jmp_buf port_out_of_the_loop; /* set by machine.c before it runs a part of the loop */

/* port.c */
void port_leave_loop(left_t how); /* does not return */
uint64_t port_now_ns(void);
uint32_t port_now_ms(void);
void port_wake(void);    /* wakes the loop */
bool port_drives(void);  /* strap and saved pin set agree: actuators are driven */
bool port_bridge(void);  /* the pin set with the bridge, driven */
bool port_rotors(void);  /* the pin set with four rotors, driven */
bool port_wheels(void);  /* the pin set with two wheels, driven */
bool port_vehicle(void); /* a pin set with a receiver and a battery, driven or not */
bool port_stalled(void);
void port_watch(bool driving); /* stall watch; driving: the actuators may move */
void port_clear_stall(void);

/* Of each file: ..._reset() sets its state after a reset; ..._advance() handles its events up to now;
 * ..._next_ns() is the time of its next event, UINT64_MAX: none; ..._faults() are its BOARD_FAULT_ bits. */
void guard_reset(void);
void guard_clock_upset(void);
uint32_t guard_faults(void);
void uart_reset(void);
void uart_advance(void);
uint64_t uart_next_ns(void);
uint32_t uart_faults(void); /* with the receiver's errors */
bool uart_waits(void);      /* received bytes wait */
void uart_unplug(void);     /* drops the bytes on the lines */
void can_reset(void);
void can_advance(void);
uint64_t can_next_ns(void);
uint32_t can_faults(void);
bool can_waits(void); /* received frames wait */
void can_unplug(void);
void receiver_reset(void);
uint32_t receiver_errors(void); /* bytes that were lost; stops at 255 */
void receiver_unplug(void);
void sensors_reset(void);
void sensors_advance(void);
uint64_t sensors_next_ns(void);
uint32_t sensors_faults(void);
void actuators_reset(void);
void actuators_advance(void);
uint32_t actuators_faults(void);

/* inside.c */
void inside_look(void);

#endif
