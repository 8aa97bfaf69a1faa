#include "command_set.h"

#if CONTROL_COMMANDS_MAX > 0U

#include "generated/messages.h"
#include <string.h>

#define LAPSE_STEPS 8U /* a set must come within this many steps: their number has four bits */

/* None before the first run. */
static unsigned frames_of(const control_system_t *system) {
    return system == NULL ? 0U : (unsigned)(system->inputs - system->counts) / COMMAND_FRAME_WORDS;
}

void command_set_begin(command_set_t *c, const control_system_t *system) {
    *c = (command_set_t){.system = system};
    command_set_neutral(c);
}

/* Writes the values that hold when nothing sets them. */
static void neutral_words(const control_system_t *system, int16_t words[CONTROL_COMMANDS_MAX]) {
    unsigned at = 0;

    memset(words, 0, CONTROL_COMMANDS_MAX * sizeof words[0]);
    for (unsigned i = 0; i < system->command_count; i++) {
        const control_command_t *const command = &system->commands[i];

        for (unsigned word = 0; word < command->words; word++) {
            words[at++] = (int16_t)(uint16_t)((uint32_t)command->neutral >> 16U * word);
        }
    }
}

void command_set_neutral(command_set_t *c) {
    c->frames = 0;
    if (c->system != NULL) {
        neutral_words(c->system, c->words);
    }
}

bool command_set_is_neutral(const command_set_t *c) {
    int16_t neutral[CONTROL_COMMANDS_MAX];

    if (c->system == NULL) {
        return true;
    }
    neutral_words(c->system, neutral);
    return memcmp(neutral, c->words, sizeof neutral) == 0;
}

/* The first frame begins a set anew; one that does not follow the frame before it ends the set. */
void command_set_receive(command_set_t *c, unsigned index, const can_frame_t *frame, uint16_t next_step) {
    const message_command_a_t m = message_command_a_unpack(frame); /* all have this shape */
    int16_t *const words = &c->received[COMMAND_FRAME_WORDS * index];

    if (index == 0) {
        c->frames = 0;
        c->number = e2e_counter(frame);
        c->begun = next_step;
    }
    if (index != c->frames || e2e_counter(frame) != c->number) {
        c->frames = 0;
        return;
    }
    words[0] = m.command_0;
    words[1] = m.command_1;
    words[2] = m.command_2;
    c->frames++;
}

static bool within_limits(const control_system_t *system, const int16_t *words) {
    for (unsigned i = 0; i < system->command_count; i++) {
        const control_command_t *const command = &system->commands[i];
        const uint32_t low = (uint16_t)words[0];
        const int32_t value =
            command->words == 1U ? words[0] : (int32_t)((uint32_t)(uint16_t)words[1] << 16 | low);

        if (value < command->low || value > command->high) {
            return false;
        }
        words += command->words;
    }
    return true;
}

command_set_state_t command_set_state(const command_set_t *c, uint16_t number, uint16_t next_step) {
    const unsigned needed = frames_of(c->system);

    if (needed == 0U) {
        return COMMAND_SET_WHOLE;
    }
    if (c->frames != needed || c->number != (number & E2E_COUNTER_MASK) ||
        (uint16_t)(next_step - c->begun) >= LAPSE_STEPS) {
        return COMMAND_SET_INCOMPLETE;
    }
    return within_limits(c->system, c->received) ? COMMAND_SET_WHOLE : COMMAND_SET_BEYOND_LIMITS;
}

void command_set_apply(command_set_t *c) {
    if (frames_of(c->system) > 0U) {
        memcpy(c->words, c->received, sizeof c->words);
    }
    c->frames = 0;
}

void command_set_copy(const command_set_t *c, int16_t raw[PLUMB_RAW_MAX]) {
    if (c->system != NULL) {
        memcpy(&raw[c->system->counts], c->words,
               (size_t)(c->system->inputs - c->system->counts) * sizeof raw[0]);
    }
}

#endif
