/* Six-step commutation of a brushless motor: Hall state and duty -> drive of each phase.
 *
 * The Hall sensors are 120 electrical degrees apart; A is bit 0, B bit 1, C bit 2. Turning forward, their
 * state goes 5, 1, 3, 2, 6, 4; 0 and 7 are invalid. One phase is driven by PWM (complementary: high side,
 * then low side), one is held low, one floats. With duty d the motor sees d times the supply between the
 * first two, of either sign, and brakes into the supply when it runs faster than that. Constant number of
 * instructions. */
#ifndef PLUMB_CORE_COMMUTATION_H
#define PLUMB_CORE_COMMUTATION_H

#include <stdbool.h>
#include <stdint.h>

#define COMMUTATION_PHASES 3

typedef enum {
    COMMUTATION_FLOAT = 0, /* both switches off */
    COMMUTATION_LOW = 1,   /* low side on */
    COMMUTATION_PWM = 2    /* high side for `on`, low side for the rest */
} commutation_drive_t;

typedef struct {
    uint8_t drive[COMMUTATION_PHASES]; /* commutation_drive_t of phase A, B, C */
    uint32_t on;                       /* of the PWM's period, 0..on_max */
} commutation_t;

/* hall: 0 to 7, higher bits are ignored. duty_q15: -32767..32767, positive turns forward; larger amounts are
 * clamped. period, on_max: in counts of the PWM, on_max <= period <= 65535; on_max leaves the low side its
 * minimum on-time. False for an invalid Hall state: then every phase floats. */
bool commutation_step(commutation_t *c, uint32_t hall, int32_t duty_q15, uint32_t period, uint32_t on_max);

/* Steps from one Hall state to the next: 1 forward, -1 backward, 0 for no change, for a jump of two or more
 * steps, and for an invalid state. */
int32_t commutation_moved(uint32_t from, uint32_t to);

#endif
