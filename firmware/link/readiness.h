/* Readiness: turns what checks the output of a system (plausibility of the sensors, conditions for a takeoff,
 * flags of its own step) into reasons against arming, and reports them to hosts. A system without checks is
 * always ready.
 *
 * Only real-time runs of a system that moves something are checked; else `checked` is NULL and nothing
 * blocks. In lockstep nothing is checked, because nothing can be armed. */
#ifndef PLUMB_LINK_READINESS_H
#define PLUMB_LINK_READINESS_H

#include "generated/messages.h"
#include "generated/params.h"
#include "systems/control.h"

/* What is missing on the side of a pilot's receiver: bits of PLAUSIBILITY.missing beside PLUMB_TAKEOFF_. */
#define READINESS_RECEIVER  0x0020U /* no frame of it comes */
#define READINESS_SWITCH_ON 0x0040U /* the motors are switched on: they have to be switched off first */
#define READINESS_LOCKED    0x0080U /* the arm switch of the board is closed, which is its lock */
#define READINESS_RAW       0x0400U /* the sensors were never calibrated */

/* What is missing of a battery that is declared: bits beside these. Reported in the air, too. */
#define READINESS_BATTERY_LOW     0x0100U /* its voltage is below battery_min_mv */
#define READINESS_BATTERY_UNKNOWN 0x0200U /* its voltage is not known, or none that a battery has */

/* Of a system whose output is checked by flags of its step: beside PLUMB_PLAUSIBILITY_ACCEL and so on in
 * failed, beside READINESS_RECEIVER and so on in missing. */
#define READINESS_OWN_FAILED  0x0008U
#define READINESS_OWN_UNREADY 0x0800U

/* Why the step of a vehicle has stopped its motors begins at this bit of failed and disarmed_by. */
#define READINESS_STOPPED_SHIFT 8U
#define READINESS_FALLEN        0x2000U /* one of these reasons: it fell, until the run ends */

/* What the last step found by its own flags. */
typedef struct {
    uint16_t failed;
    uint16_t missing;
} readiness_own_t;

typedef struct {
    union {
        plumb_plausibility_t plausibility;
        plumb_takeoff_t takeoff; /* of a system that flies */
        readiness_own_t own;     /* of one that checks itself */
    } now;
    uint16_t disarmed_by; /* PLUMB_PLAUSIBILITY_ACCEL and so on: the checks that failed last while armed */
    uint16_t stopped;     /* why the step of a vehicle has stopped the motors, shifted; 0: it has not */
    uint16_t outside;     /* READINESS_, of battery and pilot, set on every turn where an image has one */
} readiness_t;

/* Call at the start of a run of that system. */
void readiness_begin(readiness_t *r, const control_system_t *system);

/* Call after each step. checked: the system, or NULL; words: its record. */
void readiness_step(readiness_t *r, const control_system_t *checked, const params_t *params,
                    const void *words, bool armed);

/* ARMING_BLOCK_IMPLAUSIBLE while a check fails, ARMING_BLOCK_STOPPED while the step has stopped the motors,
 * ARMING_BLOCK_NOT_READY while a condition for arming is missing and the board is not armed. */
uint16_t readiness_blocked(const readiness_t *r, const control_system_t *checked, bool armed);

/* PLAUSIBILITY. */
message_plausibility_t readiness_message(const readiness_t *r, const control_system_t *checked);

#endif
