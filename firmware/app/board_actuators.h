/* What moves: the pulses of speed controllers, the three-phase bridge, and the switch that arms them. */
#ifndef PLUMB_BOARD_ACTUATORS_H
#define PLUMB_BOARD_ACTUATORS_H

#include <stdbool.h>
#include <stdint.h>

#define BOARD_ACTUATORS 2u /* pulse outputs */

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

/* Bridge: the motor gets this share of its supply, -32767..32767; positive turns it
 * forward, the way in which Hall edges count up. Nothing happens with other pins, or while the bridge is off.
 */
void board_set_bridge(int32_t duty_q15);

/* The one safe state: every output at the neutral pulse, every switch of the bridge off. */
void board_actuator_neutral(void);

/* Forget what the outputs reported: BOARD_FAULT_STALLED, and BOARD_FAULT_BRIDGE and BOARD_FAULT_HALL where
 * they are no longer so. */
void board_clear_actuator_faults(void);

#endif
