/* Actuators: pulses for speed controllers, the three-phase bridge, the drivers of two wheels, and the switch
 * that arms them. */
#ifndef PLUMB_BOARD_ACTUATORS_H
#define PLUMB_BOARD_ACTUATORS_H

#include <stdbool.h>
#include <stdint.h>

#define BOARD_ACTUATORS 2U /* pulse outputs of the pin set standard */
#define BOARD_ROTORS    4U /* pulse outputs of the pin set quadrotor */
#define BOARD_WHEELS    2U /* motors of the pin set wheels: left, right */

/* Set the outputs to neutral, and set the pulse frame's length and the neutral pulse, both in
 * half-microseconds. The frame is clamped to the bounds of core/esc.h; a neutral pulse outside them is
 * replaced by 1 ms. Takes effect with the next frame. */
void board_configure_actuator(uint32_t frame_halfus, uint32_t neutral_halfus);

/* Set the pulse lengths in half-microseconds, clamped to the bounds of core/esc.h; both take effect at the
 * start of the next frame. */
void board_set_actuator(const uint32_t pulse_halfus[BOARD_ACTUATORS]);

/* The same for the pulses of four rotors. Does nothing with another pin set. */
void board_set_rotors(const uint32_t pulse_halfus[BOARD_ROTORS]);

/* True while the arm switch is closed, not debounced. */
bool board_arm_switch(void);

/* The board has just armed: the outputs may leave neutral from now on. Switches bridge and wheels on, at duty
 * 0; after the break input has switched it off, only this function switches it on again. */
void board_arm_actuator(void);

/* Set the bridge's duty, -32767..32767 (Q15): the motor gets this share of its supply. Positive turns it
 * forward, the direction in which Hall edges count up. Does nothing with another pin set or while the bridge
 * is off. */
void board_set_bridge(int32_t duty_q15);

/* Set the duties of two motors, -32767..32767 (Q15), positive forward. Does nothing with another pin set or
 * while they are off. */
void board_set_wheels(const int32_t duty_q15[BOARD_WHEELS]);

/* The one safe state: every output at the neutral pulse, every switch of the bridge off, PWM and directions
 * of the wheels low. A neutral pulse begins at most ESC_FRAME_ENDED_HALFUS later, however long the frame is.
 */
void board_actuator_neutral(void);

/* Clear BOARD_FAULT_STALLED, and those of BOARD_FAULT_BRIDGE and BOARD_FAULT_HALL whose cause is gone. */
void board_clear_actuator_faults(void);

#endif
