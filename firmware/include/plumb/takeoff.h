/* May a vehicle that flies be armed? It has to stand still and nearly level, with an attitude that is known
 * and the throttle low, for 300 ms. A sensor that is missing or at its limit does not see it stand still. A
 * vehicle whose rotors were stopped in the air falls without turning: only the acceleration that it feels
 * tells that from standing.
 *
 * Runs after control_step() on the record of the step and changes nothing in it. Once the vehicle is armed
 * nothing here takes anything away: in the air a check that fails by mistake is a crash. What stops the
 * rotors in flight is decided in the step itself. */
#ifndef PLUMB_TAKEOFF_H
#define PLUMB_TAKEOFF_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What is missing. Bits, as those of PLUMB_PLAUSIBILITY_ (plausibility.h) and in PLAUSIBILITY. */
#define PLUMB_TAKEOFF_SETTLING    0x0001U /* the other conditions have not held for long enough */
#define PLUMB_TAKEOFF_MOVING      0x0002U /* it turns, or flies or falls */
#define PLUMB_TAKEOFF_CONVERGING  0x0004U /* the attitude is not known well enough */
#define PLUMB_TAKEOFF_SETPOINT    0x0008U /* the throttle is not low */
#define PLUMB_TAKEOFF_TILTED      0x0010U /* too far from level */
#define PLUMB_TAKEOFF_MISSING_ALL 0x001FU

/* What is asked of a system: the places of the signals in its record, in words of 32 bits from its start, and
 * their limits. */
typedef struct {
    uint8_t throttle; /* Q15 */
    uint8_t rate;     /* turn/s Q28, the first of three axes */
    uint8_t up_z;     /* vertical component of the body's z axis, Q30 */
    uint8_t variance; /* of the tilt, rad^2 Q32 */
    uint8_t flags;    /* of the step */
    uint8_t stopped;  /* why the step has stopped the rotors, until they are switched off; 0: it has not */
    uint16_t blind;   /* flags of a sample that was missing or at a limit: it counts as a turn of 2 turn/s */
    uint16_t
        stands; /* flags of the step that all say that it stands on the ground; 0: the step cannot tell */
    int32_t throttle_max_q15;
    uint32_t rest_turnps_q28; /* largest mean, over 0.25 s, of the fastest axis' rate */
    int32_t up_z_min_q30;
    uint32_t variance_max_rad2_q32;
} plumb_takeoff_bounds_t;

typedef struct {
    uint32_t ready_s_q33;          /* how long all conditions have been met; stops at its limit */
    uint32_t rate_mean_turnps_q28; /* mean over 0.25 s of the fastest axis' rate, up to 2 turn/s */
    uint32_t missing;              /* PLUMB_TAKEOFF_, now */
} plumb_takeoff_t;

/* Call at the start of a run: all conditions are missing. */
void plumb_takeoff_init(plumb_takeoff_t *t);

/* Call after each step. record: its words; dt_s_q33: the period, up to 0.1 s. */
void plumb_takeoff_step(plumb_takeoff_t *t, const plumb_takeoff_bounds_t *bounds, const void *record,
                        uint32_t dt_s_q33);

#ifdef __cplusplus
}
#endif

#endif
