/* Commands of a step besides the setpoint: a set of them acts as a whole, or not at all.
 *
 * The frames of a set come in order, and the SETPOINT of the same step completes it. They carry the low four
 * bits of its step number. A set counts when all its frames have come and every value is within the limits
 * that the system declares; its age is that of its SETPOINT (setpoint.h). The words are those of the system's
 * declaration, 16 bits each. Only images with a system that declares commands contain this code. */
#ifndef PLUMB_LINK_COMMAND_SET_H
#define PLUMB_LINK_COMMAND_SET_H

#include "link/e2e.h"
#include "systems/control.h"

#if CONTROL_COMMANDS_MAX > 0U

#define COMMAND_FRAME_WORDS 3U
#define COMMAND_FRAMES      (CONTROL_COMMANDS_MAX / COMMAND_FRAME_WORDS)

typedef struct {
    const control_system_t *system;         /* of the run; NULL before the first */
    int16_t words[CONTROL_COMMANDS_MAX];    /* in use */
    int16_t received[CONTROL_COMMANDS_MAX]; /* of the set that is coming in */
    uint8_t frames;                         /* how many of its frames have come */
    uint8_t number;                         /* the low four bits of its step */
    uint16_t begun;                         /* the run's next step when its first frame came */
} command_set_t;

/* Call at the start of a run: every command has the value that it has when nothing sets it. */
void command_set_begin(command_set_t *c, const control_system_t *system);

/* Every command gets the value that it has when nothing sets it. */
void command_set_neutral(command_set_t *c);
bool command_set_is_neutral(const command_set_t *c);

/* Handle frame `index` of a set. next_step: of the run. */
void command_set_receive(command_set_t *c, unsigned index, const can_frame_t *frame, uint16_t next_step);

typedef enum {
    COMMAND_SET_WHOLE,
    COMMAND_SET_INCOMPLETE,
    COMMAND_SET_BEYOND_LIMITS,
} command_set_state_t;

/* State of the set that the SETPOINT of step `number` completes. next_step: of the run. */
command_set_state_t command_set_state(const command_set_t *c, uint16_t number, uint16_t next_step);

/* The set that came in becomes the one in use. Call after COMMAND_SET_WHOLE alone. */
void command_set_apply(command_set_t *c);

/* Write the commands in use behind the raw counts. */
void command_set_copy(const command_set_t *c, int16_t raw[PLUMB_RAW_MAX]);

#endif
#endif
