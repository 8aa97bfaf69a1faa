/* One step of the system that the parameters select: from raw counts to outputs, with all intermediate
 * values.
 *
 * The caller owns all memory. A step depends only on its arguments and *c. The words of a step are its
 * record, in the order of the system's plumb_X_words_t; the digest is the CRC-32 of their bytes,
 * little-endian. Every record begins with the inputs (raw counts, then the 16-bit words of commands) and the
 * setpoint and ends with the flags and the step number (2 words). No output depends on arming or on time.
 *
 * The systems are declared in host/plumb/systems/NAME/system.toml. generated/systems.c, which is generated
 * from the declarations, implements this header.
 */
#ifndef PLUMB_SYSTEMS_CONTROL_H
#define PLUMB_SYSTEMS_CONTROL_H

#include "generated/system_headers.h"
#include "plumb/plausibility.h"
#include "plumb/takeoff.h"
#include <stddef.h>

#define CONTROL_RECORD_WORDS_MAX (sizeof(control_words_t) / 4U)

/* Actuator that the output words of a system drive. */
typedef enum {
    CONTROL_OUTPUT_NONE = 0, /* nothing: never armed */
    CONTROL_OUTPUT_PULSES,   /* two words, half-microseconds: speed controllers */
    CONTROL_OUTPUT_BRIDGE,   /* one word, duty Q15: three-phase bridge */
    CONTROL_OUTPUT_ROTORS,   /* four words, half-microseconds: the pulse of each rotor's speed controller */
    CONTROL_OUTPUT_WHEELS /* two words, duty Q15 of either sign: the motors of two wheels, left and right */
} control_output_t;

/* Sensors of the board that a live run samples: BOARD_SENSORS_ of app/board_sensors.h. */
typedef enum {
    CONTROL_SENSORS_NONE = 0, /* none: samples come from the host */
    CONTROL_SENSORS_ANALOG_3, /* three analog inputs */
    CONTROL_SENSORS_ANALOG_6, /* six analog inputs; INT16_MIN where an input is at a rail or hangs */
    CONTROL_SENSORS_BALANCE,  /* angular rate and two accelerations of the digital sensors, Hall edges */
    CONTROL_SENSORS_SIX_AXES, /* three angular rates, three accelerations of the digital sensors */
    CONTROL_SENSORS_RIDE      /* two angular rates, two accelerations of the digital sensors, two encoders, a
                                 switch */
} control_sensors_t;

#define CONTROL_NO_WORD 255U /* in a frame: its 16 bits are 0 */

/* One frame of telemetry, its words by their place in the record. */
typedef struct {
    uint16_t id;
    uint8_t half;  /* the 16 bits; or CONTROL_NO_WORD */
    uint8_t shift; /* 0: its low 16 bits; else this many low bits are dropped, and the rest is saturated */
    uint8_t word;  /* the 32 bits */
} control_frame_t;

/* One input of a step that a host sets. Its words follow those of the one before it, the low one first. */
typedef struct {
    int32_t low, high; /* limits */
    int32_t neutral;   /* value while no host sets it */
    uint8_t words;     /* 1 or 2, of 16 bits */
} control_command_t;

/* Properties of a system, without its code. */
typedef struct {
    const control_frame_t *frames;
    const plumb_plausibility_bounds_t *plausibility; /* of the checks `axis` and `ride`, else NULL */
    const plumb_takeoff_bounds_t *takeoff;           /* of the checks `flight`, else NULL */
#if CONTROL_CHECKS_OWN
    uint32_t fails;   /* flags of the step by which the system's own checks fail */
    uint32_t unready; /* flags of the step by which it is not ready to be armed */
#endif
    uint32_t saturated; /* flags that say that a raw count was outside its range */
    uint16_t record_words;
    uint16_t noisy; /* bits of the raw counts that calibrated sensors give: at rest they are not constant */
    uint8_t frame_count;
    uint8_t output;      /* control_output_t */
    uint8_t output_word; /* place in the record of the first word that drives it */
    uint8_t sensors;     /* control_sensors_t */
    uint8_t counts;      /* raw counts of a step */
    uint8_t inputs;      /* and words of commands, in whole frames */
    bool marks_missing;  /* a step without a sample gets counts of INT16_MIN; else the last sample again */
    bool owner_alone;    /* setpoints and commands come from the owner of the run; else from the named link */
#if CONTROL_LEARNS
    uint8_t learned_word;       /* what a run learns: place in the record; 0: nothing */
    uint16_t learned_parameter; /* number of the parameter that the next run begins with */
#endif
#if CONTROL_COMMANDS_MAX > 0U
    const control_command_t *commands;
    uint8_t command_count;
    bool has_receiver; /* the board's receiver may set setpoint and commands (link/receiver.h) */
#endif
} control_system_t;

/* Properties of the system in use. A system that this image does not have has a record of two zeros, no
 * frames and no output. */
const control_system_t *control_system(const plumb_params_t *p);

/* State at the start of a run: the record is zero but for the start values of filters and controllers. */
void control_init(control_t *c, const plumb_params_t *p);

/* Checks that the ranges of single parameters cannot express: false if the image does not have the system, or
 * if a sum of its step could overflow. Call before parameters come into use, not in every step. */
bool control_params_valid(const plumb_params_t *p);

/* One step. raw: counts, then words of commands; setpoint: in the system's unit (its declaration says which).
 * The result is in the words. */
void control_step(control_t *c, const plumb_params_t *p, const int16_t raw[PLUMB_RAW_MAX], int32_t setpoint);

/* Other values of live parameters (host/plumb/spec/parameters.toml) from the next step on: moves the state of
 * the controllers so that their demand does not jump. Call between two steps, before they come into use. */
void control_retune(control_t *c, const plumb_params_t *from, const plumb_params_t *to);

/* The record of the last step: control_words_bytes() bytes, read by word of 32 bits. */
static inline const int32_t *control_words(const control_t *c) {
    return (const int32_t *)(const void *)c;
}

/* A multiple of 4. */
static inline size_t control_words_bytes(const plumb_params_t *p) {
    return 4U * (size_t)control_system(p)->record_words;
}

/* True when a raw count of the last step was outside its range. */
static inline bool control_saturated(const control_t *c, const plumb_params_t *p) {
    const control_system_t *const system = control_system(p);
    const uint32_t flags = (uint32_t)control_words(c)[system->record_words - 2];

    return (flags & system->saturated) != 0U;
}

#endif
