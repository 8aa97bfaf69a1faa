/* What the files of this port share; the host sees native.h alone. */
#ifndef PLUMB_NATIVE_PORT_H
#define PLUMB_NATIVE_PORT_H

#include "app/board_guard.h"
#include "app/board_links.h"
#include "app/board_store.h"
#include "native.h"

/* board.c */
uint64_t port_now_ns(void);
uint32_t port_now_ms(void);
void port_wake(void);        /* the loop has something to look at */
void port_power_fails(void); /* in the middle of what the loop does; does not return */
bool port_drives(void);      /* strap and saved pin set agree: actuators are driven */
bool port_bridge(void);      /* the pin set with the bridge, driven */
bool port_stalled(void);
void port_watch(bool driving); /* the actuators may move, or are at neutral */
void port_clear_stall(void);

/* Each file's state as a reset leaves it, and what happened in it up to now. */
void guard_reset(void);
void guard_clock_upset(void);
uint32_t guard_faults(void);
void links_reset(void);
void links_advance(void);
uint64_t links_next_ns(void); /* when something wakes the loop, UINT64_MAX: never */
uint32_t links_faults(void);
void links_unplug(void); /* what is on the lines is gone */
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
